#pragma once

// Files in and out. Everything thrown names the file (and the view and field, where there are some).
// Readers bound what they allocate by the size of the file and by kMaxPixels.

#include <filesystem>
#include <string>
#include <string_view>

#include "lapseam/image.h"
#include "lapseam/mesh.h"
#include "lapseam/view.h"

namespace lapseam {

class Context;

/// No image of more pixels is read.
inline constexpr std::size_t kMaxPixels = std::size_t(1) << 30;

// ---- scenes and views

/// Opens whatever docs/formats.md lists: a manifest (scene.json), a file of scans (E57, PTX, PCD, .sens), a Stanford
/// .conf, EXR files, or a folder as RGB-D tools write it; by content. Of scans the points are read, to find their
/// sensors; of images only headers. Checks that files exist and that poses are rigid.
/// With skip_bad_views, a view that cannot be used is left out with a warning instead of an exception.
struct ReadSceneOptions {
  bool skip_bad_views = false;
};
Scene read_scene(const std::filesystem::path& path, const ReadSceneOptions& options, Context& context);

/// Writes the manifest; file paths are stored relative to it where they lie below its folder, else absolute.
void write_scene(const Scene& scene, const std::filesystem::path& file);

/// Decodes one range image. Thread-safe. Throws InvalidInput when it has no valid sample or the wrong size.
View load_view(const ViewSource& source);
/// Decodes the colour image of a view. Throws InvalidInput when the view has none or its size is not the camera's.
ColorImage load_color(const ViewSource& source);

// ---- images
ColorImage read_color_image(const std::filesystem::path& file);  ///< EXR, PNG, JPEG, by content
void write_png(const std::filesystem::path& file, const ColorImage& image);
void write_png8(const std::filesystem::path& file, const Image<std::uint8_t>& image);  ///< greyscale
void write_png16(const std::filesystem::path& file, const Image<std::uint16_t>& image);
Image<std::uint16_t> read_png16(const std::filesystem::path& file);
/// Range image as single-channel float EXR, with our sensor and pose attributes (docs/formats.md), and colour when
/// given.
void write_range_exr(const std::filesystem::path& file, const RangeImage& range, const Sensor& sensor,
                     const Eigen::Isometry3d& T_world_view, const ColorImage* color = nullptr);

// ---- text

/// A report, a table. The name shows it only when it is complete: what was there before stays until then, and after a
/// failure. A device or a pipe is written to directly. Throws IoError.
void write_text(const std::filesystem::path& file, std::string_view text);

// ---- meshes

enum class TextureFormat {
  kJpeg,
  kPng,   ///< lossless, and hardly larger than a JPEG whose blocks do not show at borders of charts
  kWebp,  ///< GLB only (EXT_texture_webp): about half of the JPEG's size, colour at half resolution
};

struct WriteMeshOptions {
  bool with_provenance = true;                         ///< PLY: per-vertex view and pixel, per-face view and tag
  TextureFormat texture_format = TextureFormat::kPng;  ///< GLB and OBJ texture pages
  int texture_quality = 100;                           ///< 1 to 100; of JPEG and WebP
  // GLB only:
  bool is_lit = false;    ///< a matte material that a viewer lights; otherwise textures and colours show as they are
  bool quantize = false;  ///< 16-bit positions and texture coordinates (KHR_mesh_quantization)
  bool compress =
      false;  ///< triangles and vertices packed by meshoptimizer (EXT_meshopt_compression), in another order
};
/// By the ending of the name: .ply (binary), .obj (+ .mtl + pages), .glb, .stl (triangles alone). Written to a
/// temporary name, then renamed.
void write_mesh(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options = {});
/// PLY (ascii or binary), OBJ, GLB, by content; polygons are fanned; texture pages are read where there are some.
Mesh read_mesh(const std::filesystem::path& file);

}  // namespace lapseam
