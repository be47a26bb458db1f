#pragma once

// The outer layer of an E57 file (ASTM E2807): pages of 1024 bytes, of which the last four are a checksum. Offsets in
// the file are physical when they count the checksums, logical when they do not.

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "io/source.h"
#include "lapseam/context.h"

namespace lapseam {

inline constexpr std::uint64_t kE57PageBytes = 1024, kE57PayloadBytes = 1020;

inline std::uint64_t to_logical(std::uint64_t physical) {
  return physical / kE57PageBytes * kE57PayloadBytes + physical % kE57PageBytes;
}
inline std::uint64_t to_physical(std::uint64_t logical) {
  return logical / kE57PayloadBytes * kE57PageBytes + logical % kE57PayloadBytes;
}

class PagedFile {
 public:
  /// Reads and checks the file's header. Pages are read so many at a time: few for readers that jump.
  explicit PagedFile(const Source& source, std::uint64_t block_pages = 256);

  /// The XML section.
  std::string read_xml();
  /// Bytes at a logical offset; every page is checked. Refuses what lies beyond the end.
  void read(std::uint64_t logical_offset, std::size_t count, char* out);
  /// Checks `count` pages, from this one on.
  void check(std::uint64_t first_page, std::uint64_t count);
  std::uint64_t pages() const { return pages_; }
  std::uint64_t logical_bytes() const { return pages_ * kE57PayloadBytes; }
  const Source& source() const { return source_; }

 private:
  void load_block(std::uint64_t first_page);

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  Source source_;
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t most_block_pages_ = 0;
  std::uint64_t pages_ = 0, xml_offset_ = 0, xml_bytes_ = 0;
  std::uint64_t block_page_ = 0, block_bytes_ = 0;  ///< the checked block: its first page, its payload
  std::vector<char> block_;
};

/// Checks all pages of a file, side by side.
void check_e57_pages(const Source& source, Context& context);

}  // namespace lapseam
