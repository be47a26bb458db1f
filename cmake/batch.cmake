# lapseam_batch(TARGET SIZE [ALONE...]): with LAPSEAM_BATCH, that many files of the target are compiled as one, so that
# headers are read once for all of them: half the time for a build from scratch, but more for one after a small change.
# Not those of ALONE. It is off unless asked for, by tools/test, tools/demo and the sanitized presets.
function(lapseam_batch target size)
  if(LAPSEAM_BATCH)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE ${size})
    set_source_files_properties(${ARGN} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
  endif()
endfunction()

# Such files are large: by default GCC spends a tenth of its time collecting garbage of a few dozen megabytes.
if(LAPSEAM_BATCH AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  add_compile_options(--param=ggc-min-expand=100 --param=ggc-min-heapsize=700000)
endif()
