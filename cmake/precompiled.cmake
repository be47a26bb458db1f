# lapseam_precompile(TARGET GROUP HEADERS...): with LAPSEAM_PCH, the targets of a group share one precompiled header, which
# the first of them builds. Half of the compiler's time goes into the same headers again and again. It is off unless
# asked for, by tools/test and the sanitized presets, so that every file is known to include what it uses.
function(lapseam_precompile target group)
  if(NOT LAPSEAM_PCH)
    return()
  endif()
  get_property(owner GLOBAL PROPERTY LAPSEAM_PCH_${group})
  if(owner)
    target_precompile_headers(${target} REUSE_FROM ${owner})
    return()
  endif()
  target_precompile_headers(${target} PRIVATE ${ARGN})
  set_property(GLOBAL PROPERTY LAPSEAM_PCH_${group} ${target})
endfunction()
set(LAPSEAM_PCH_STANDARD <algorithm> <array> <atomic> <cmath> <cstdint> <filesystem> <functional> <limits> <map> <memory>
    <numeric> <optional> <span> <string> <string_view> <tuple> <variant> <vector> <Eigen/Dense>)
