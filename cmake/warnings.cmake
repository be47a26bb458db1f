# lapseam_target(NAME): the language level, warnings and numeric model that every target of the project shares.
function(lapseam_target target)
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_compile_options(${target} PRIVATE
    -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Wold-style-cast -Wcast-align -Wunused -Woverloaded-virtual
    -Wnull-dereference -Wdouble-promotion
    # Results must not depend on which products the compiler fuses.
    -ffp-contract=off)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # GCC 12 sees null, overlapping and out-of-bounds accesses that are not there, deep inside Eigen and the standard
    # library (GCC bugs 105329, 105651).
    target_compile_options(${target} PRIVATE -Wno-null-dereference -Wno-array-bounds -Wno-stringop-overflow
                                             -Wno-maybe-uninitialized -Wno-restrict)
  endif()
  if(LAPSEAM_WARNINGS_AS_ERRORS)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
endfunction()
