# Everything that is found outside the project. Consumers of the installed package find the part that the library's
# interface and a static link need: see lapseamConfig.cmake.in.
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(TBB REQUIRED)
find_package(embree 3.13 REQUIRED)
find_package(nanoflann REQUIRED)
find_package(OpenEXR 3.1 REQUIRED QUIET)  # or Imath's package talks at length about its Python library
find_package(nlohmann_json 3.11 REQUIRED)
find_package(fmt 9 REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(SPNG REQUIRED IMPORTED_TARGET spng)
pkg_check_modules(TURBOJPEG REQUIRED IMPORTED_TARGET libturbojpeg)
if(LAPSEAM_BUILD_TOOL OR LAPSEAM_BUILD_BENCH)
  find_package(CLI11 2.1 REQUIRED)
endif()

if(LAPSEAM_IPO)
  include(CheckIPOSupported)
  check_ipo_supported(RESULT ipo_works OUTPUT ipo_problem LANGUAGES CXX)
  if(NOT ipo_works)
    message(FATAL_ERROR "LAPSEAM_IPO is on, but this compiler cannot: ${ipo_problem}")
  endif()
  set(CMAKE_INTERPROCEDURAL_OPTIMIZATION ON)
endif()
