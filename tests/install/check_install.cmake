# Run by CTest; stops with an error at the first thing that is wrong.
cmake_minimum_required(VERSION 3.25)

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(NOT result EQUAL 0)
    string(JOIN " " command ${ARGN})
    message(FATAL_ERROR "${command}\nended with ${result}:\n${output}")
  endif()
  set(output "${output}" PARENT_SCOPE)
endfunction()

set(prefix ${SCRATCH_DIR}/prefix)
file(REMOVE_RECURSE ${SCRATCH_DIR})
run(${CMAKE_COMMAND} --install ${BUILD_DIR} --prefix ${prefix})

# The package must work after the sources and the build are gone.
file(GLOB_RECURSE package_files ${prefix}/*.cmake ${prefix}/*.h)
foreach(file ${package_files})
  file(READ ${file} text)
  foreach(folder ${SOURCE_DIR} ${BUILD_DIR})
    string(FIND "${text}" "${folder}" found)
    # The scratch prefix may lie inside the build folder; the package files must not know that either.
    if(NOT found EQUAL -1)
      message(FATAL_ERROR "${file} names ${folder}")
    endif()
  endforeach()
endforeach()

# Every public header must stand alone, so the consumer includes each in a file of its own.
file(GLOB headers RELATIVE ${prefix}/include ${prefix}/include/lapseam/*.h)
list(LENGTH headers header_count)
if(header_count LESS 8)
  message(FATAL_ERROR "only ${header_count} headers were installed")
endif()
set(header_sources)
foreach(header ${headers})
  string(MAKE_C_IDENTIFIER ${header} name)
  file(WRITE ${SCRATCH_DIR}/headers/${name}.cpp "#include \"${header}\"\n")
  list(APPEND header_sources ${SCRATCH_DIR}/headers/${name}.cpp)
endforeach()

run(${CMAKE_COMMAND} -S ${CMAKE_CURRENT_LIST_DIR}/consumer -B ${SCRATCH_DIR}/build -G Ninja
    -D CMAKE_BUILD_TYPE=${BUILD_TYPE} -D CMAKE_CXX_COMPILER=${CXX_COMPILER} "-DCMAKE_CXX_FLAGS=${CXX_FLAGS}"
    -D CMAKE_PREFIX_PATH=${prefix} -D CMAKE_FIND_USE_PACKAGE_REGISTRY=OFF -D WANTED_VERSION=${VERSION}
    "-DHEADER_SOURCES=${header_sources}")
run(${CMAKE_COMMAND} --build ${SCRATCH_DIR}/build)
run(${SCRATCH_DIR}/build/consumer ${SCRATCH_DIR})
if(NOT output MATCHES "lapseam ${VERSION}: [1-9][0-9]* triangles")
  message(FATAL_ERROR "the consumer printed: ${output}")
endif()
message(STATUS "${output}")

if(WITH_TOOL)
  run(${prefix}/bin/lapseam --version)
  if(NOT output STREQUAL "lapseam ${VERSION}\n")
    message(FATAL_ERROR "the installed tool printed: ${output}")
  endif()
endif()
file(REMOVE_RECURSE ${SCRATCH_DIR})
