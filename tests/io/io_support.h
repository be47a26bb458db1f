#pragma once

// Folders that vanish, small files, and the promise that every refusal keeps.

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <string>
#include <string_view>

#include "lapseam/error.h"
#include "lapseam/image.h"

namespace lapseam::test {

/// A new folder for one test; removed at its end.
class TempFolder {
 public:
  TempFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "lapseam_io_XXXXXX").string();
    path_ = mkdtemp(pattern.data());
  }
  ~TempFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline void write_bytes(const std::filesystem::path& file, std::string_view bytes) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary).write(bytes.data(), std::streamsize(bytes.size()));
}

inline std::string read_bytes(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// f must throw InvalidInput whose message is one line and holds all of `words`.
template <typename F>
void expect_refused(const F& f, std::initializer_list<std::string> words) {
  try {
    f();
    ADD_FAILURE() << "nothing was thrown; expected a message with " << *words.begin();
  } catch (const InvalidInput& error) {
    const std::string message = error.what();
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    for (const std::string& word : words)
      EXPECT_NE(message.find(word), std::string::npos) << word << " is not in: " << message;
  }
}

/// Smoothly different in every pixel.
inline ColorImage make_color(int width, int height) {
  ColorImage image(width, height);
  for (int v = 0; v < height; ++v)
    for (int u = 0; u < width; ++u)
      image.at(u, v) = {std::uint8_t(u * 5 + v), std::uint8_t(40 + v * 3), std::uint8_t(200 - u)};
  return image;
}

/// The shared real scans; empty when they are not there.
inline std::filesystem::path data_folder() {
  const char* variable = std::getenv("LAPSEAM_DATA");
  const std::filesystem::path folder = variable ? variable : "../shared/data";
  return std::filesystem::is_directory(folder) ? folder : std::filesystem::path();
}

}  // namespace lapseam::test
