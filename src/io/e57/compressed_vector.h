#pragma once

// The records of a CompressedVector section: packets, each with a piece of every field's stream of packed numbers.

#include <span>
#include <vector>

#include "io/e57/document.h"
#include "io/e57/paged_file.h"

namespace lapseam {

/// One field's packed numbers, appended as packets come, taken off as records are complete.
class E57Stream {
 public:
  /// `skipped_bits` of what will be appended belong to records before the first one.
  explicit E57Stream(const E57Field& field, std::uint64_t skipped_bits = 0)
      : field_(field), used_bits_(std::size_t(skipped_bits)) {}

  void append(PagedFile& file, std::uint64_t offset, std::size_t count);
  std::uint64_t records() const;
  /// The next `count` numbers, scaled, or, as integers, raw.
  void take(std::size_t count, double* out);

 private:
  void take_packed(std::size_t count, double* out);

  E57Field field_;
  std::vector<char> bytes_;
  std::size_t used_bits_ = 0;
};

/// Where the packets of a section lie, so that readers may begin in the middle of it. At most a few times as large as
/// the section's packet headers.
struct E57Index {
  std::vector<std::uint64_t> packets;       ///< logical offsets of the data packets
  std::vector<std::uint64_t> stream_bytes;  ///< packet-major: bytes of each field in the packets before this one
};
/// Steps through the packets' headers. Refuses what E57Records refuses.
E57Index index_packets(PagedFile& file, const E57Scan& scan);

/// Records [begin, end).
struct RecordRange {
  std::uint64_t begin = 0, end = 0;
};

/// Reads records in blocks; fields that are not wanted are stepped over.
class E57Records {
 public:
  /// All records. Refuses more than the section can hold.
  E57Records(PagedFile& file, const E57Scan& scan, std::vector<int> wanted);
  /// Some of them.
  E57Records(PagedFile& file, const E57Scan& scan, std::vector<int> wanted, const E57Index& index, RecordRange range);

  static constexpr std::size_t kBlock = 4096;
  /// The next block: column k has the numbers of field wanted[k]. Nothing at the end.
  std::size_t next();
  std::span<const double> column(std::size_t k) const { return columns_[k]; }

 private:
  friend E57Index index_packets(PagedFile& file, const E57Scan& scan);

  void open_section();
  /// Calls visit(field, logical offset, bytes) for each stream of the next packet; false: it holds no records.
  template <typename Visit>
  bool walk_packet(const Visit& visit);
  void read_packet();
  void refuse_truncated() const;

  PagedFile& file_;
  const E57Scan& scan_;
  std::vector<int> wanted_;
  std::vector<E57Stream> streams_;
  std::vector<std::vector<double>> columns_;
  std::vector<std::uint16_t> lengths_;
  std::uint64_t left_ = 0, position_ = 0, end_ = 0;  ///< records; logical offsets
};

/// The bytes of a blob section. Refuses one that lies beyond the end of the file.
std::vector<char> read_e57_blob(PagedFile& file, std::uint64_t physical_offset, std::uint64_t count);

}  // namespace lapseam
