#pragma once

// TBB gives a process no more workers than the machine has cores, whatever an arena asks for. Tests that compare results
// over more threads than that must raise the limit, or they would compare two threads with two.

#include <tbb/global_control.h>

namespace lapseam::test {

inline const tbb::global_control& allow_threads() {
  static const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 8);
  return limit;
}

}  // namespace lapseam::test
