#pragma once

#include <cstdint>

namespace lapseam {

/// High-water mark of this process's resident memory, from the operating system; 0 where it does not tell.
std::uint64_t peak_rss_bytes();

}  // namespace lapseam
