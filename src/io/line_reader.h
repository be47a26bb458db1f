#pragma once

// Lines of a text file of any size, through a buffer of fixed size.

#include <cstdint>
#include <cstdio>
#include <memory>
#include <string_view>
#include <vector>

#include "io/source.h"

namespace lapseam {

class LineReader {
 public:
  /// Refuses, in next(), lines that are longer than any line of such a file can be.
  LineReader(const Source& source, std::uint64_t offset);

  /// Cuts off the next line, without its end; false at the end of the file. Valid until the next call.
  bool next(std::string_view& line);
  /// Steps over lines; false when there are fewer.
  bool skip(std::uint64_t count);
  /// Where the next line begins, bytes from the beginning of the file.
  std::uint64_t offset() const { return buffer_offset_ + begin_; }
  /// Of the line that next() gave last, from where the reader began; the first is 1.
  std::uint64_t line_number() const { return line_number_; }

 private:
  bool fill();

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  Source source_;
  std::unique_ptr<std::FILE, Close> file_;
  std::vector<char> buffer_;
  std::uint64_t buffer_offset_ = 0, line_number_ = 0;
  std::size_t begin_ = 0, end_ = 0;
  bool is_at_end_ = false;
};

}  // namespace lapseam
