#pragma once

#include <cstddef>
#include <cstdint>

namespace lapseam {

/// The cyclic redundancy check of Castagnoli et al. 1993, as iSCSI (RFC 3720) and E57 use it.
std::uint32_t crc32c(const char* bytes, std::size_t count);

}  // namespace lapseam
