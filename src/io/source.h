#pragma once

// Which file is being read, and for which view: what every error has to name.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "lapseam/error.h"

namespace lapseam {

struct Source {
  std::filesystem::path file;
  std::string view;  ///< empty when the file belongs to no view

  /// Throws InvalidInput. Control characters, which names in damaged files may hold, become question marks.
  [[noreturn]] void refuse(const std::string& field, const std::string& problem) const;
};

struct ImageSize {
  int width = 0, height = 0;
  friend bool operator==(const ImageSize&, const ImageSize&) = default;
};

/// "640 × 480" in plain letters.
std::string to_string(ImageSize size);

enum class FileKind {
  kPng,
  kJpeg,
  kExr,
  kPly,
  kJson,
  kStanfordConf,
  kE57,
  kPtx,
  kPcd,
  kSens,
  kColmapDepth,
  kNpy,
  kUnknown
};
/// By the first bytes, never by the name. Throws IoError when the file cannot be read.
FileKind recognise_file(const std::filesystem::path& file);
/// "a PNG image", "a file of unknown kind".
std::string_view describe(FileKind kind);

/// Refuses an image of no pixels, of more than kMaxPixels, or of more than a file of this size can hold: no codec packs
/// more than `max_pixels_per_byte` into a byte. To be called before anything is allocated.
void check_image_size(const Source& source, std::uint64_t width, std::uint64_t height, std::uint64_t file_bytes,
                      std::uint64_t max_pixels_per_byte);

/// Throws IoError, for what is no regular file too.
std::uint64_t file_size_bytes(const std::filesystem::path& file);

/// The first `count` bytes, or all of a shorter file. Throws IoError.
std::string read_file_start(const std::filesystem::path& file, std::size_t count);

}  // namespace lapseam
