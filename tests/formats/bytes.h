#pragma once

#include <string>

namespace lapseam::test {

/// As it lies in memory: what little-endian formats hold.
template <typename T>
void append(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace lapseam::test
