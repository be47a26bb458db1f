# lapseam_batch(TARGET SIZE): with LAPSEAM_BATCH, that many files of the target are compiled as one, so that headers are read
# once for all of them: a third less time for a build from scratch, but more for one after a small change. Not for targets
# whose files give one name to different things of their own. It is off unless asked for, by tools/test and the sanitized presets.
function(lapseam_batch target size)
  if(LAPSEAM_BATCH)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE ${size})
  endif()
endfunction()
