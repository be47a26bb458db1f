#pragma once

#include <cstdint>
#include <optional>

namespace lapseam {

/// High-water mark of this process's resident memory, from the operating system; 0 where it does not tell.
std::uint64_t peak_rss_bytes();
/// Resident memory of this process now; 0 where the system does not tell. Some microseconds.
std::uint64_t rss_bytes();
/// What the allocator keeps for later, where it tells.
std::optional<std::uint64_t> free_memory_bytes();
/// Gives the system back what the allocator keeps for later.
void release_free_memory();

}  // namespace lapseam
