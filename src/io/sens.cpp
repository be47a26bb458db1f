#include "io/sens.h"

#include <zlib.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>

#include "io/rigid.h"
#include "lapseam/context.h"

namespace lapseam {
namespace {

constexpr std::uint32_t kVersion = 4;
constexpr std::int32_t kRaw = 0, kPngColor = 1, kJpegColor = 2, kZlibDepth = 1;
constexpr std::uint64_t kFrameHeaderBytes = 16 * 4 + 4 * 8;
// A frame's pose is stored in single precision, after a chain of them.
constexpr double kPoseTolerance = 1e-2;
constexpr std::uint64_t kMaxNameBytes = 4096;
// As for PNG: deflate packs at most 1032 bytes into one; a sample has two.
constexpr std::uint64_t kMaxPixelsPerByte = 516;

struct Header {
  std::array<float, 16> color_intrinsic, color_extrinsic, depth_intrinsic, depth_extrinsic;
  std::int32_t color_compression, depth_compression;
  std::uint32_t color_width, color_height, depth_width, depth_height;
  float depth_shift;
};

/// Reads values one after another, never beyond the end of the file.
class Reader {
 public:
  explicit Reader(const Source& source)
      : source_(source), file_(std::fopen(source.file.c_str(), "rb")), size_(file_size_bytes(source.file)) {
    if (!file_) throw IoError(source.file, "cannot read");
  }

  template <typename T>
  T take(const char* field) {
    T value;
    read(field, &value, sizeof value);
    return value;
  }
  std::vector<char> bytes(const char* field, std::uint64_t count) {
    if (count > size_ - position_) source_.refuse(field, "the file is truncated");
    std::vector<char> out(static_cast<std::size_t>(count));
    read(field, out.data(), out.size());
    return out;
  }
  void skip(const char* field, std::uint64_t count) {
    if (count > size_ - position_) source_.refuse(field, "the file is truncated");
    go_to(position_ + count);
  }
  void go_to(std::uint64_t offset) {
    if (offset > size_ || fseeko(file_.get(), off_t(offset), SEEK_SET) != 0)
      source_.refuse({}, "a frame lies beyond the end of the file");
    position_ = offset;
  }
  std::uint64_t position() const { return position_; }
  std::uint64_t left() const { return size_ - position_; }

 private:
  void read(const char* field, void* out, std::size_t count) {
    if (count > size_ - position_ || std::fread(out, 1, count, file_.get()) != count)
      source_.refuse(field, "the file is truncated");
    position_ += count;
  }

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  const Source& source_;
  std::unique_ptr<std::FILE, Close> file_;
  std::uint64_t size_, position_ = 0;
};

struct Recording {
  Header header;
  std::uint64_t frames = 0, first_offset = 0;
};

Recording read_header(const Source& source, Reader& reader) {
  Recording recording;
  if (reader.take<std::uint32_t>("version") != kVersion) source.refuse("version", "is not 4");
  const auto name_bytes = reader.take<std::uint64_t>("sensor name");
  if (name_bytes > kMaxNameBytes) source.refuse("sensor name", "is longer than any name");
  reader.skip("sensor name", name_bytes);
  recording.header = reader.take<Header>("header");
  recording.frames = reader.take<std::uint64_t>("frames");
  recording.first_offset = reader.position();
  const Header& h = recording.header;
  if (recording.frames > reader.left() / kFrameHeaderBytes)
    source.refuse("frames", "claims " + std::to_string(recording.frames) + ", more than the file holds");
  check_image_size(source, h.depth_width, h.depth_height, file_size_bytes(source.file), kMaxPixelsPerByte);
  if (!(h.depth_shift > 0) || !std::isfinite(h.depth_shift)) source.refuse("depthShift", "must be positive");
  if (h.depth_compression != kRaw && h.depth_compression != kZlibDepth)
    source.refuse("depthCompression", "type " + std::to_string(h.depth_compression) + " is not read; raw and zlib are");
  return recording;
}

SensFrame read_frame(Reader& reader) {
  SensFrame frame;
  frame.offset = reader.position();
  const auto pose = reader.take<std::array<float, 16>>("frame");
  for (int i = 0; i < 16; ++i) frame.T_world_view(i / 4, i % 4) = double(pose[std::size_t(i)]);
  reader.skip("frame", 16);  // time stamps
  frame.color_bytes = reader.take<std::uint64_t>("frame");
  frame.depth_bytes = reader.take<std::uint64_t>("frame");
  return frame;
}

/// The reader stands at the frame's colour bytes then.
SensFrame find_frame(const Source& source, Reader& reader, const Recording& recording, std::uint32_t index,
                     std::uint64_t offset) {
  if (index >= recording.frames)
    source.refuse("range.index",
                  "there is no frame " + std::to_string(index) + "; the file has " + std::to_string(recording.frames));
  reader.go_to(offset > 0 ? offset : recording.first_offset);
  for (std::uint32_t i = offset > 0 ? index : 0;; ++i) {
    const SensFrame frame = read_frame(reader);
    if (i == index) return frame;
    reader.skip("frame", frame.color_bytes);
    reader.skip("frame", frame.depth_bytes);
  }
}

PinholeSensor camera_of(const Source& source, const char* field, const std::array<float, 16>& k, std::uint32_t width,
                        std::uint32_t height) {
  const PinholeSensor camera{int(width), int(height), double(k[0]), double(k[5]), double(k[2]), double(k[6]), {}};
  if (!(camera.fx > 0 && camera.fy > 0 && std::isfinite(camera.fx + camera.fy + camera.cx + camera.cy)))
    source.refuse(field, "has no focal length");
  return camera;
}

Eigen::Isometry3d extrinsic_of(const Source& source, const char* field, const std::array<float, 16>& stored) {
  Eigen::Matrix4d matrix;
  for (int i = 0; i < 16; ++i) matrix(i / 4, i % 4) = double(stored[std::size_t(i)]);
  // Devices without calibration store zeros.
  if (matrix.isZero(0)) return Eigen::Isometry3d::Identity();
  return to_rigid(matrix, source, field, kPoseTolerance);
}

ColorSource color_of(const Source& source, const Header& h, std::uint32_t index, std::uint64_t offset) {
  ColorSource color;
  color.file = source.file;
  color.index = index;
  color.offset = offset;
  check_image_size(source, h.color_width, h.color_height, file_size_bytes(source.file), 512);
  color.camera = camera_of(source, "colour intrinsics", h.color_intrinsic, h.color_width, h.color_height);
  color.T_view_color = extrinsic_of(source, "depth extrinsics", h.depth_extrinsic).inverse() *
                       extrinsic_of(source, "colour extrinsics", h.color_extrinsic);
  return color;
}

}  // namespace

bool looks_like_sens(std::string_view start) {
  if (start.size() < 12) return false;
  std::uint32_t version;
  std::uint64_t name_bytes;
  std::memcpy(&version, start.data(), sizeof version);
  std::memcpy(&name_bytes, start.data() + 4, sizeof name_bytes);
  return version == kVersion && name_bytes <= kMaxNameBytes;
}

Scene read_sens(const std::filesystem::path& path, const ReadSceneOptions& options, Context& context) {
  const Source source{path, {}};
  Reader reader(source);
  const Recording recording = read_header(source, reader);
  const Header& h = recording.header;
  const PinholeSensor camera = camera_of(source, "depth intrinsics", h.depth_intrinsic, h.depth_width, h.depth_height);
  SceneBuilder builder(path, options, context);
  builder.set_name(path.stem().string());
  std::size_t lost = 0;
  for (std::uint32_t index = 0; index < recording.frames; ++index) {
    const SensFrame frame = read_frame(reader);
    reader.skip("frame", frame.color_bytes);
    reader.skip("frame", frame.depth_bytes);
    // Where tracking was lost, poses are infinite.
    if (!frame.T_world_view.allFinite() && ++lost) continue;
    char name[24];
    std::snprintf(name, sizeof name, "frame-%06u", index);
    builder.add([&] {
      ViewDraft draft;
      ViewSource& view = draft.view;
      view.name = name;
      view.sensor = camera;
      view.T_world_view = to_rigid(frame.T_world_view, {path, name}, "pose", kPoseTolerance);
      draft.has_pose = true;
      view.range.file = path;
      view.range.format = RangeFormat::kSens;
      view.range.index = index;
      view.range.offset = frame.offset;
      view.range.scale_m = 1.0 / double(h.depth_shift);
      view.range.invalid_values = {65535};
      if (frame.color_bytes > 0) view.color = color_of({path, name}, h, index, frame.offset);
      return draft;
    });
  }
  if (lost > 0)
    context.warn(path.string() + ": " + std::to_string(lost) +
                 " frames have an infinite pose (tracking was lost) and are left out");
  return builder.finish();
}

Image<std::uint16_t> read_sens_depth(const Source& source, std::uint32_t index, std::uint64_t offset) {
  Reader reader(source);
  const Recording recording = read_header(source, reader);
  const SensFrame frame = find_frame(source, reader, recording, index, offset);
  reader.skip("frame", frame.color_bytes);
  const std::vector<char> packed = reader.bytes("depth", frame.depth_bytes);
  const Header& h = recording.header;
  check_image_size(source, h.depth_width, h.depth_height, packed.size(), kMaxPixelsPerByte);
  Image<std::uint16_t> depth(int(h.depth_width), int(h.depth_height));
  const std::size_t bytes = depth.size() * sizeof(std::uint16_t);
  if (h.depth_compression == kRaw) {
    if (packed.size() != bytes)
      source.refuse("depth", "has " + std::to_string(packed.size()) + " bytes for its pixels");
    std::memcpy(depth.pixels.data(), packed.data(), bytes);
    return depth;
  }
  uLongf unpacked = bytes;
  const int result = uncompress(reinterpret_cast<Bytef*>(depth.pixels.data()), &unpacked,
                                reinterpret_cast<const Bytef*>(packed.data()), packed.size());
  if (result != Z_OK || unpacked != bytes) source.refuse("depth", "the compressed depth image is damaged");
  return depth;
}

ColorImage read_sens_color(const Source& source, std::uint32_t index, std::uint64_t offset) {
  Reader reader(source);
  const Recording recording = read_header(source, reader);
  const SensFrame frame = find_frame(source, reader, recording, index, offset);
  const std::vector<char> bytes = reader.bytes("color", frame.color_bytes);
  const Header& h = recording.header;
  if (h.color_compression == kJpegColor) return decode_jpeg(source, bytes);
  if (h.color_compression == kPngColor) return decode_png(source, bytes);
  if (h.color_compression != kRaw) source.refuse("colorCompression", "this type is not read; raw, PNG and JPEG are");
  check_image_size(source, h.color_width, h.color_height, bytes.size(), 1);
  ColorImage image(int(h.color_width), int(h.color_height));
  if (bytes.size() != image.size() * sizeof(Rgb8)) source.refuse("color", "has the wrong number of bytes");
  std::memcpy(image.pixels.data(), bytes.data(), bytes.size());
  return image;
}

}  // namespace lapseam
