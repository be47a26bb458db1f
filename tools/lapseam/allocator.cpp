#include "allocator.h"

#include <cstddef>

#ifdef LAPSEAM_TCMALLOC
#include <gperftools/malloc_extension_c.h>
#elif defined(__GLIBC__)
#include <malloc.h>
#endif

namespace lapseam::tool {

void set_up_allocator() {
#ifdef LAPSEAM_TCMALLOC
  // There are few threads, and many of the arrays are large: what a thread keeps is of no use to the others.
  constexpr std::size_t kKeptByThreads = 8 << 20;
  MallocExtension_SetNumericProperty("tcmalloc.max_total_thread_cache_bytes", kKeptByThreads);
#elif defined(__GLIBC__)
  // Large arrays come and go: each returns to the system at once, which the allocator would learn not to do. A sixth
  // less memory at the peak of integration.
  constexpr int kLarge = 256 * 1024;
  mallopt(M_MMAP_THRESHOLD, kLarge);
  mallopt(M_TRIM_THRESHOLD, kLarge);
#endif
}

}  // namespace lapseam::tool
