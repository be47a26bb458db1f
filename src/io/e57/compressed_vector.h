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
  explicit E57Stream(const E57Field& field) : field_(field) {}

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

/// Reads records in blocks; fields that are not wanted are stepped over.
class E57Records {
 public:
  /// Refuses more records than the section can hold.
  E57Records(PagedFile& file, const E57Scan& scan, std::vector<int> wanted);

  static constexpr std::size_t kBlock = 4096;
  /// The next block: column k has the numbers of field wanted[k]. Nothing at the end.
  std::size_t next();
  std::span<const double> column(std::size_t k) const { return columns_[k]; }

 private:
  void read_packet();
  void refuse_truncated() const;

  PagedFile& file_;
  const E57Scan& scan_;
  std::vector<int> wanted_;
  std::vector<E57Stream> streams_;
  std::vector<std::vector<double>> columns_;
  std::uint64_t left_ = 0, position_ = 0, end_ = 0;  ///< records; logical offsets
};

/// The bytes of a blob section. Refuses one that lies beyond the end of the file.
std::vector<char> read_e57_blob(PagedFile& file, std::uint64_t physical_offset, std::uint64_t count);

}  // namespace lapseam
