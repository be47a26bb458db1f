#pragma once

#include <cstdint>

namespace lapseam {

/// High-water mark of this process's resident memory, from the operating system; 0 where it does not tell.
std::uint64_t peak_rss_bytes();
/// Resident memory of this process now; 0 where the system does not tell. Some microseconds.
std::uint64_t rss_bytes();

}  // namespace lapseam
