#include "core/memory.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdio>

namespace lapseam {

std::uint64_t peak_rss_bytes() {
  rusage usage{};
  if (getrusage(RUSAGE_SELF, &usage) != 0) return 0;
  return std::uint64_t(usage.ru_maxrss) * 1024;  // Linux counts in KiB
}

std::uint64_t rss_bytes() {
  const int descriptor = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return 0;
  char text[128] = {};
  const ssize_t length = ::read(descriptor, text, sizeof text - 1);
  ::close(descriptor);
  unsigned long long all = 0, resident = 0;
  if (length <= 0 || std::sscanf(text, "%llu %llu", &all, &resident) != 2) return 0;
  static const auto page = std::uint64_t(::sysconf(_SC_PAGESIZE));
  return std::uint64_t(resident) * page;
}

}  // namespace lapseam
