# LAPSEAM_SANITIZED: the flags have a sanitizer, as those of the presets asan, fuzz and tsan.
if(CMAKE_CXX_FLAGS MATCHES "-fsanitize=")
  set(LAPSEAM_SANITIZED ON)
else()
  set(LAPSEAM_SANITIZED OFF)
endif()

# lapseam_instrument(TARGET): what the presets asan and fuzz leave out elsewhere. Checks of every pointer (null, alignment,
# object size, overflow) double the compiler's time; they are made where hostile bytes go, in the readers, and so is
# counted which branches a damaged file takes. Everywhere else the address sanitizer sees a bad pointer when it is used.
function(lapseam_instrument target)
  if(NOT CMAKE_CXX_FLAGS MATCHES "-fsanitize=address" OR NOT target MATCHES "^lapseam_(io|mesh)$")
    return()
  endif()
  target_compile_options(${target} PRIVATE -fsanitize=undefined)
  if(LAPSEAM_FUZZ)
    target_compile_options(${target} PRIVATE -fsanitize=fuzzer-no-link)
  endif()
endfunction()
