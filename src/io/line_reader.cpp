#include "io/line_reader.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <system_error>

namespace lapseam {
namespace {

constexpr std::size_t kBufferBytes = std::size_t(1) << 20, kLongestLine = 1 << 16;

/// One byte more than a small file, so that its end shows as a buffer that is not full.
std::size_t choose_buffer_bytes(const std::filesystem::path& file) {
  return std::size_t(std::min<std::uint64_t>(kBufferBytes, file_size_bytes(file) + 1));
}

}  // namespace

LineReader::LineReader(const Source& source, std::uint64_t offset)
    : source_(source),
      file_(std::fopen(source.file.c_str(), "rb")),
      buffer_(choose_buffer_bytes(source.file)),
      buffer_offset_(offset) {
  if (!file_ || fseeko(file_.get(), off_t(offset), SEEK_SET) != 0)
    throw IoError(source.file, "cannot read: " + std::generic_category().message(errno));
}

bool LineReader::fill() {
  if (is_at_end_) return false;
  std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
  buffer_offset_ += begin_;
  end_ -= begin_;
  begin_ = 0;
  const std::size_t count = std::fread(buffer_.data() + end_, 1, buffer_.size() - end_, file_.get());
  if (std::ferror(file_.get())) throw IoError(source_.file, "cannot read: " + std::generic_category().message(errno));
  end_ += count;
  is_at_end_ = count == 0;
  return count > 0;
}

bool LineReader::next(std::string_view& line) {
  for (;;) {
    const char* start = buffer_.data() + begin_;
    const auto* newline = static_cast<const char*>(std::memchr(start, '\n', end_ - begin_));
    if (!newline && end_ - begin_ > kLongestLine)
      source_.refuse("line " + std::to_string(line_number_ + 1), "is longer than a line of such a file can be");
    if (!newline && fill()) continue;
    const std::size_t length = newline ? std::size_t(newline - start) : end_ - begin_;
    if (!newline && length == 0) return false;
    line = {start, length};
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    begin_ += length + (newline ? 1 : 0);
    ++line_number_;
    return true;
  }
}

bool LineReader::skip(std::uint64_t count) {
  std::string_view line;
  while (count > 0 && next(line)) --count;
  return count == 0;
}

}  // namespace lapseam
