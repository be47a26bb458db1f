#pragma once

// Texture pages to and from the bytes of an image file.

#include <filesystem>
#include <span>
#include <vector>

#include "lapseam/image.h"
#include "lapseam/io.h"

namespace lapseam {

/// No chroma subsampling: neighbouring charts of a page must not bleed into each other.
/// Throws InvalidInput (without a file) for an empty image, one over 65,500 pixels wide or high, or a quality outside
/// 1…100.
std::vector<char> encode_jpeg(const ColorImage& image, int quality);

/// In one of the formats that pages are written in; quality: of JPEG and WebP. Throws as encode_jpeg does; a WebP image
/// has up to 16,383 pixels in each direction.
std::vector<char> encode_page(const ColorImage& image, TextureFormat format, int quality);
/// "image/jpeg" and the like; ".jpg" and the like.
const char* mime_type(TextureFormat format);
const char* file_ending(TextureFormat format);

/// JPEG, PNG or WebP, by content. `file` is the one that the bytes are in, for errors (InvalidInput).
ColorImage decode_page(std::span<const char> bytes, const std::filesystem::path& file);

}  // namespace lapseam
