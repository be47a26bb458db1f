#pragma once

// Writes a file so that its name never shows half of it: the bytes go to a temporary name in the same folder, which is
// renamed at the end and removed on failure. What a killed process left behind is removed by the next writer of the
// name. All failures are IoError with the path that was asked for.

#include <cstdio>
#include <filesystem>
#include <string_view>
#include <type_traits>
#include <vector>

namespace lapseam {

class OutputFile {
 public:
  /// A name that is something else than a regular file (a device, a pipe) is written directly; a link is followed.
  explicit OutputFile(const std::filesystem::path& file);
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  void write(const void* data, std::size_t size_bytes) {
    if (buffered_ + size_bytes > buffer_.size()) return write_through(data, size_bytes);
    copy_to_buffer(data, size_bytes);
  }
  void write(std::string_view text) { write(text.data(), text.size()); }
  /// The bytes of a plain value, in the machine's order.
  template <typename T>
  void put(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    write(&value, sizeof value);
  }

  /// Bytes that have been written already; files only, not pipes.
  void overwrite(long offset, std::string_view bytes);

  /// Everything is on its way to the disk under the temporary name; what the disk refuses shows here.
  void close();
  /// close(), then the file appears under its name.
  void commit();

 private:
  void copy_to_buffer(const void* data, std::size_t size_bytes);
  void write_through(const void* data, std::size_t size_bytes);
  void flush();
  [[noreturn]] void fail(const char* action);

  std::filesystem::path file_;
  std::filesystem::path target_;
  std::filesystem::path temporary_;  ///< empty when written directly, or when committed
  std::FILE* stream_ = nullptr;
  int lock_holder_ = -1;  ///< says that the temporary file's writer lives
  std::vector<char> buffer_;
  std::size_t buffered_ = 0;
};

/// The whole file. Throws IoError.
std::vector<char> read_file_bytes(const std::filesystem::path& file);

}  // namespace lapseam
