#include "io/output_file.h"

#include <cerrno>
#include <cstring>
#include <system_error>

#include "lapseam/error.h"

namespace lapseam {
namespace {

constexpr std::size_t kBufferBytes = std::size_t(1) << 20;

std::string describe_errno() { return std::generic_category().message(errno); }

/// A new, empty file beside `target`; the name is free because "x" refuses to open what exists.
std::FILE* open_temporary(const std::filesystem::path& target, std::filesystem::path& temporary) {
  for (int attempt = 0; attempt < 10000; ++attempt) {
    temporary = target;
    temporary.replace_filename("." + target.filename().string() + ".part" + std::to_string(attempt));
    std::FILE* stream = std::fopen(temporary.c_str(), "wbx");
    if (stream || errno != EEXIST) return stream;
  }
  return nullptr;
}

}  // namespace

OutputFile::OutputFile(const std::filesystem::path& file) : file_(file), target_(file), buffer_(kBufferBytes) {
  std::error_code ignored;
  if (std::filesystem::is_symlink(file, ignored)) {
    const auto resolved = std::filesystem::weakly_canonical(file, ignored);
    if (!ignored) target_ = resolved;
  }
  const std::filesystem::file_status status = std::filesystem::status(target_, ignored);
  if (std::filesystem::is_directory(status)) throw IoError(file_, "cannot write: this is a folder");
  const bool write_directly = std::filesystem::exists(status) && !std::filesystem::is_regular_file(status);
  stream_ = write_directly ? std::fopen(target_.c_str(), "wb") : open_temporary(target_, temporary_);
  if (!stream_) {
    const std::string problem = "cannot write: " + describe_errno();
    temporary_.clear();
    throw IoError(file_, problem);
  }
  // The buffer here is the only one.
  std::setvbuf(stream_, nullptr, _IONBF, 0);
}

OutputFile::~OutputFile() {
  if (stream_) std::fclose(stream_);
  std::error_code ignored;
  if (!temporary_.empty()) std::filesystem::remove(temporary_, ignored);
}

void OutputFile::fail(const char* action) { throw IoError(file_, std::string(action) + ": " + describe_errno()); }

void OutputFile::copy_to_buffer(const void* data, std::size_t size_bytes) {
  if (size_bytes == 0) return;
  std::memcpy(buffer_.data() + buffered_, data, size_bytes);
  buffered_ += size_bytes;
}

void OutputFile::write_through(const void* data, std::size_t size_bytes) {
  flush();
  if (size_bytes <= buffer_.size()) return copy_to_buffer(data, size_bytes);
  if (std::fwrite(data, 1, size_bytes, stream_) != size_bytes) fail("cannot write");
}

void OutputFile::flush() {
  const std::size_t size_bytes = buffered_;
  buffered_ = 0;
  if (size_bytes && std::fwrite(buffer_.data(), 1, size_bytes, stream_) != size_bytes) fail("cannot write");
}

void OutputFile::overwrite(long offset, std::string_view bytes) {
  flush();
  if (std::fseek(stream_, offset, SEEK_SET) != 0 ||
      std::fwrite(bytes.data(), 1, bytes.size(), stream_) != bytes.size() || std::fseek(stream_, 0, SEEK_END) != 0)
    fail("cannot write");
}

void OutputFile::close() {
  if (!stream_) return;
  flush();
  const bool is_closed = std::fclose(stream_) == 0;
  stream_ = nullptr;
  if (!is_closed) fail("cannot write");
  buffer_ = {};
}

void OutputFile::commit() {
  close();
  if (temporary_.empty()) return;
  if (std::rename(temporary_.c_str(), target_.c_str()) != 0) fail("cannot rename the finished file");
  temporary_.clear();
}

std::vector<char> read_file_bytes(const std::filesystem::path& file) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(file, error);
  if (std::filesystem::is_directory(status)) throw IoError(file, "cannot read: this is a folder");
  std::FILE* stream = std::fopen(file.c_str(), "rb");
  if (!stream) throw IoError(file, "cannot read: " + describe_errno());
  const std::uintmax_t size = std::filesystem::is_regular_file(status) ? std::filesystem::file_size(file, error) : 0;
  std::vector<char> bytes(error ? 0 : std::size_t(size));
  if (!bytes.empty()) bytes.resize(std::fread(bytes.data(), 1, bytes.size(), stream));
  // Pipes have no size, and a file may have grown meanwhile: go on to the end.
  for (char block[1 << 16]; const std::size_t count = std::fread(block, 1, sizeof block, stream);)
    bytes.insert(bytes.end(), block, block + count);
  const bool has_failed = std::ferror(stream) != 0;
  const std::string problem = has_failed ? "cannot read: " + describe_errno() : std::string();
  std::fclose(stream);
  if (has_failed) throw IoError(file, problem);
  return bytes;
}

}  // namespace lapseam
