include(CMakePackageConfigHelpers)

set(LAPSEAM_PACKAGE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/lapseam)

install(TARGETS lapseam EXPORT lapseamTargets)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/lapseam DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
        FILES_MATCHING PATTERN "*.h")
install(FILES ${PROJECT_BINARY_DIR}/include/lapseam/version.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/lapseam)
install(EXPORT lapseamTargets NAMESPACE lapseam:: DESTINATION ${LAPSEAM_PACKAGE_DIR})

configure_package_config_file(cmake/lapseamConfig.cmake.in ${PROJECT_BINARY_DIR}/lapseamConfig.cmake
                              INSTALL_DESTINATION ${LAPSEAM_PACKAGE_DIR})
# Before 1.0 a minor version may change the interface.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/lapseamConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/lapseamConfig.cmake ${PROJECT_BINARY_DIR}/lapseamConfigVersion.cmake
        DESTINATION ${LAPSEAM_PACKAGE_DIR})

if(TARGET lapseam_tool)
  install(TARGETS lapseam_tool RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/licenses/lapseam)
