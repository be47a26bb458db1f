#include "core/crc32c.h"

#include <array>
#include <cstring>

namespace lapseam {
namespace {

constexpr std::uint32_t kReversedPolynomial = 0x82F63B78u;

using Tables = std::array<std::array<std::uint32_t, 256>, 8>;

constexpr Tables make_tables() {
  Tables tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? crc >> 1 ^ kReversedPolynomial : crc >> 1;
    tables[0][i] = crc;
  }
  for (std::size_t t = 1; t < 8; ++t)
    for (std::size_t i = 0; i < 256; ++i) tables[t][i] = tables[t - 1][i] >> 8 ^ tables[0][tables[t - 1][i] & 0xFF];
  return tables;
}

constexpr Tables kTables = make_tables();

/// Eight bytes at a time (Kounavis and Berry 2005).
std::uint32_t crc_by_tables(const char* bytes, std::size_t count) {
  std::uint32_t crc = ~0u;
  for (; count >= 8; bytes += 8, count -= 8) {
    std::uint64_t word;
    std::memcpy(&word, bytes, sizeof word);
    word ^= crc;
    crc = 0;
    for (std::size_t i = 0; i < 8; ++i) crc ^= kTables[7 - i][word >> (8 * i) & 0xFF];
  }
  for (; count > 0; ++bytes, --count) crc = crc >> 8 ^ kTables[0][(crc ^ std::uint8_t(*bytes)) & 0xFF];
  return ~crc;
}

#if defined(__x86_64__)
__attribute__((target("sse4.2"))) std::uint32_t crc_by_instruction(const char* bytes, std::size_t count) {
  std::uint64_t crc = ~0u;
  for (; count >= 8; bytes += 8, count -= 8) {
    std::uint64_t word;
    std::memcpy(&word, bytes, sizeof word);
    crc = __builtin_ia32_crc32di(crc, word);
  }
  auto rest = std::uint32_t(crc);
  for (; count > 0; ++bytes, --count) rest = __builtin_ia32_crc32qi(rest, std::uint8_t(*bytes));
  return ~rest;
}
#endif

}  // namespace

std::uint32_t crc32c(const char* bytes, std::size_t count) {
#if defined(__x86_64__)
  static const bool has_instruction = __builtin_cpu_supports("sse4.2");
  if (has_instruction) return crc_by_instruction(bytes, count);
#endif
  return crc_by_tables(bytes, count);
}

}  // namespace lapseam
