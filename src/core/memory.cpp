#include "core/memory.h"

#include <sys/resource.h>

namespace lapseam {

std::uint64_t peak_rss_bytes() {
  rusage usage{};
  if (getrusage(RUSAGE_SELF, &usage) != 0) return 0;
  return std::uint64_t(usage.ru_maxrss) * 1024;  // Linux counts in KiB
}

}  // namespace lapseam
