#include "core/memory.h"

#include <fcntl.h>
#include <malloc.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstddef>
#include <cstdio>

// Of gperftools, where a program has chosen its allocator: null elsewhere. The library itself chooses none.
extern "C" {
[[gnu::weak]] int MallocExtension_GetNumericProperty(const char* property, std::size_t* value);
[[gnu::weak]] void MallocExtension_ReleaseFreeMemory();
}

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

std::optional<std::uint64_t> free_memory_bytes() {
  std::size_t bytes = 0;
  if (!MallocExtension_GetNumericProperty ||
      !MallocExtension_GetNumericProperty("tcmalloc.pageheap_free_bytes", &bytes))
    return {};
  return bytes;
}

void release_free_memory() {
  if (MallocExtension_ReleaseFreeMemory)
    MallocExtension_ReleaseFreeMemory();
  else
    ::malloc_trim(0);
}

}  // namespace lapseam
