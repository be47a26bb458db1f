#include "io/output_file.h"

#include <fcntl.h>
#include <stdio.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "lapseam/error.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

constexpr std::size_t kBufferBytes = std::size_t(1) << 20;

std::string describe_errno() { return std::generic_category().message(errno); }

std::filesystem::path temporary_name(const std::filesystem::path& target, int attempt) {
  std::filesystem::path temporary = target;
  return temporary.replace_filename("." + target.filename().string() + ".part" + std::to_string(attempt));
}

/// The writer of a temporary file holds a lock on it, which ends with its process, however that ends. What can be
/// locked was left behind by one that was killed.
void remove_if_left_behind(const std::filesystem::path& temporary) {
  const int descriptor = ::open(temporary.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW);
  if (descriptor < 0) return;
  struct stat status {};
  if (::fstat(descriptor, &status) == 0 && S_ISREG(status.st_mode) && ::flock(descriptor, LOCK_EX | LOCK_NB) == 0)
    ::unlink(temporary.c_str());
  ::close(descriptor);
}

/// Locks what was just made; false where another writer took it for left behind, and removed it, a moment before. Where
/// files cannot be locked nothing is taken for that.
bool lock(int descriptor, const std::filesystem::path& temporary) {
  struct stat by_descriptor {
  }, by_name{};
  if (::flock(descriptor, LOCK_EX) != 0) return true;
  return ::fstat(descriptor, &by_descriptor) == 0 && ::stat(temporary.c_str(), &by_name) == 0 &&
         by_descriptor.st_ino == by_name.st_ino && by_descriptor.st_dev == by_name.st_dev;
}

/// A new, empty file beside `target`; the name is free because "x" refuses to open what exists.
std::FILE* open_temporary(const std::filesystem::path& target, std::filesystem::path& temporary, int& lock_holder) {
  // As many as writers of one file are likely to have been killed side by side.
  constexpr int kSweptNames = 8;
  for (int attempt = 0; attempt < kSweptNames; ++attempt) remove_if_left_behind(temporary_name(target, attempt));
  for (int attempt = 0; attempt < 10000; ++attempt) {
    temporary = temporary_name(target, attempt);
    std::FILE* stream = std::fopen(temporary.c_str(), "wbxe");
    if (!stream && errno != EEXIST) return nullptr;
    if (!stream) continue;
    // A second descriptor keeps the lock from when the stream is closed to when the file has its name.
    lock_holder = ::fcntl(fileno(stream), F_DUPFD_CLOEXEC, 0);
    if (lock(fileno(stream), temporary)) return stream;
    std::fclose(stream);
    if (lock_holder >= 0) ::close(std::exchange(lock_holder, -1));
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
  stream_ = write_directly ? std::fopen(target_.c_str(), "wb") : open_temporary(target_, temporary_, lock_holder_);
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
  if (lock_holder_ >= 0) ::close(lock_holder_);
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

void write_text(const std::filesystem::path& file, std::string_view text) {
  OutputFile out(file);
  out.write(text);
  out.commit();
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
