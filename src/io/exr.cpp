#include "io/exr.h"

#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfPartType.h>
#include <ImfStandardAttributes.h>
#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "io/exr_attributes.h"
#include "io/exr_precheck.h"
#include "io/output_file.h"
#include "lapseam/io.h"

namespace lapseam {
namespace {

std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

/// Runs f; turns what OpenEXR throws into our own errors.
template <typename F>
auto guarded(const Source& source, const F& f) {
  try {
    return f();
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    source.refuse({}, "damaged EXR image: it asks for more memory than there is");
  } catch (const std::exception& error) {
    source.refuse({}, "damaged EXR image: " + one_line(error.what()));
  }
}

/// An open EXR file whose headers have passed check_exr_headers. No threads of OpenEXR's: the caller brings its own.
class Reader {
 public:
  explicit Reader(const Source& source) : source_(source), file_(source.file.c_str(), 0) {
    if (header().hasType() && Imf::isDeepData(header().type())) source.refuse({}, "deep EXR images cannot be read");
    const Imath::Box2i window = header().dataWindow();
    size_ = {window.max.x - window.min.x + 1, window.max.y - window.min.y + 1};
  }

  const Imf::Header& header() const { return file_.header(); }
  ImageSize size() const { return size_; }

  std::vector<std::string> channels() const {
    std::vector<std::string> names;
    for (auto it = header().channels().begin(); it != header().channels().end(); ++it) names.emplace_back(it.name());
    return names;
  }
  bool has(const char* channel) const { return header().channels().findChannel(channel) != nullptr; }

  /// Several channels in one pass over the file: `stride` floats apart in `out`, one after another.
  void read(const std::vector<std::string>& names, float* out) {
    if (!file_.isComplete()) source_.refuse({}, "damaged EXR image: it is truncated");
    const std::size_t pixel_bytes = names.size() * sizeof(float);
    const std::size_t row_bytes = pixel_bytes * std::size_t(size_.width);
    const Imath::Box2i window = header().dataWindow();
    // The slice's base is where pixel (0, 0) would be, which need not lie inside the data window. As integers: a
    // pointer outside its array must not be formed by pointer arithmetic.
    const auto origin = std::intptr_t(window.min.x) * std::intptr_t(pixel_bytes) +
                        std::intptr_t(window.min.y) * std::intptr_t(row_bytes);
    Imf::FrameBuffer buffer;
    for (std::size_t i = 0; i < names.size(); ++i) {
      const Imf::Channel& channel = header().channels()[names[i].c_str()];
      if (channel.xSampling != 1 || channel.ySampling != 1)
        source_.refuse("channel '" + names[i] + "'", "is subsampled");
      const auto base = reinterpret_cast<std::intptr_t>(out + i) - origin;
      buffer.insert(names[i].c_str(),
                    Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(base), pixel_bytes, row_bytes, 1, 1, 0.0));
    }
    file_.setFrameBuffer(buffer);
    file_.readPixels(window.min.y, window.max.y);
  }

 private:
  const Source& source_;
  Imf::InputFile file_;
  ImageSize size_;
};

template <typename F>
auto with_reader(const Source& source, const F& f) {
  // OpenEXR's own message for a missing file names errors of its streams; ours is plain.
  const FileKind kind = recognise_file(source.file);
  if (kind != FileKind::kExr) source.refuse({}, "expected an EXR image; this is " + std::string(describe(kind)));
  check_exr_headers(source);
  return guarded(source, [&] {
    Reader reader(source);
    return f(reader);
  });
}

std::vector<Eigen::Vector2f> read_warp(const Source& source, Reader& reader) {
  std::vector<Eigen::Vector2f> warp(std::size_t(reader.size().width) * std::size_t(reader.size().height));
  reader.read({kWarpUChannel, kWarpVChannel}, warp.front().data());
  const bool is_finite = std::all_of(warp.begin(), warp.end(), [](const auto& w) { return w.allFinite(); });
  if (!is_finite) source.refuse(kWarpUChannel, "is not finite");
  return warp;
}

std::uint8_t to_srgb8(float linear) {
  const double x = std::isfinite(linear) ? std::clamp(double(linear), 0.0, 1.0) : 0.0;
  const double srgb = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
  return std::uint8_t(std::lround(srgb * 255.0));
}

float to_linear(std::uint8_t srgb8) {
  const double x = srgb8 / 255.0;
  return float(x <= 0.04045 ? x / 12.92 : std::pow((x + 0.055) / 1.055, 2.4));
}

/// OpenEXR writes into memory; the finished bytes then go to the file in one piece, under a temporary name.
class MemoryStream : public Imf::OStream {
 public:
  MemoryStream() : Imf::OStream("memory") {}
  void write(const char bytes[], int count) override {
    const std::size_t end = position_ + std::size_t(count);
    if (end > bytes_.size()) bytes_.resize(end);
    std::memcpy(bytes_.data() + position_, bytes, std::size_t(count));
    position_ = end;
  }
  std::uint64_t tellp() override { return position_; }
  void seekp(std::uint64_t position) override { position_ = std::size_t(position); }
  const std::vector<char>& bytes() const { return bytes_; }

 private:
  std::vector<char> bytes_;
  std::size_t position_ = 0;
};

Imf::Slice slice_of(Imf::PixelType type, const void* pixels, std::size_t pixel_bytes, int width) {
  // OpenEXR's frame buffers have no const; the output only reads them.
  char* base = static_cast<char*>(const_cast<void*>(pixels));
  return {type, base, pixel_bytes, pixel_bytes * std::size_t(width)};
}

std::vector<half> to_linear_halves(const ColorImage& color) {
  std::array<half, 256> table;
  for (std::size_t i = 0; i < table.size(); ++i) table[i] = half(to_linear(std::uint8_t(i)));
  std::vector<half> halves;
  halves.reserve(color.size() * 3);
  for (const Rgb8 pixel : color.pixels) halves.insert(halves.end(), {table[pixel.r], table[pixel.g], table[pixel.b]});
  return halves;
}

/// Null where the sensor has none.
const std::vector<Eigen::Vector2f>* warp_of(const Sensor& sensor) {
  if (const auto* grid = std::get_if<MeasuredGridSensor>(&sensor)) return &grid->warp;
  if (const auto* spherical = std::get_if<SphericalSensor>(&sensor)) return spherical->warp.get();
  return nullptr;
}

/// The warp of a sensor, one plane a channel; OpenEXR's strides allow the pairs as they are.
void add_warp(const std::vector<Eigen::Vector2f>& warp, int width, Imf::Header& header, Imf::FrameBuffer& buffer) {
  constexpr std::size_t kPairBytes = sizeof(Eigen::Vector2f);
  static_assert(kPairBytes == 2 * sizeof(float));
  header.channels().insert(kWarpUChannel, Imf::Channel(Imf::FLOAT));
  header.channels().insert(kWarpVChannel, Imf::Channel(Imf::FLOAT));
  buffer.insert(kWarpUChannel, slice_of(Imf::FLOAT, warp.front().data(), kPairBytes, width));
  buffer.insert(kWarpVChannel, slice_of(Imf::FLOAT, warp.front().data() + 1, kPairBytes, width));
}

void check_writable(const std::filesystem::path& file, const RangeImage& range, const Sensor& sensor,
                    const ColorImage* color) {
  const Source source{file, {}};
  if (range.empty()) source.refuse("size", "an image without pixels cannot be written");
  const ImageSize size{range.width, range.height}, sensor_size{width(sensor), height(sensor)};
  if (size != sensor_size)
    source.refuse("size", "the range image is " + to_string(size) + ", its sensor " + to_string(sensor_size));
  if (color && ImageSize{color->width, color->height} != size)
    source.refuse("size", "colour in the same file must have the size of the range image");
  const std::vector<Eigen::Vector2f>* warp = warp_of(sensor);
  if (warp && warp->size() != range.size()) source.refuse("sensor", "the warp table has the wrong size");
}

}  // namespace

ExrHeader read_exr_header(const Source& source) {
  return with_reader(source, [&](Reader& reader) {
    ExrHeader header;
    header.size = reader.size();
    header.channels = reader.channels();
    header.has_rgb = reader.has("R") && reader.has("G") && reader.has("B");
    read_attributes(source, reader.header(), header);
    auto* spherical = header.sensor ? std::get_if<SphericalSensor>(&*header.sensor) : nullptr;
    if (spherical && reader.has(kWarpUChannel) && reader.has(kWarpVChannel))
      spherical->warp = std::make_shared<std::vector<Eigen::Vector2f>>(read_warp(source, reader));
    return header;
  });
}

std::string choose_range_channel(const Source& source, const std::vector<std::string>& channels,
                                 const std::string& wanted) {
  const auto has = [&](const std::string& name) {
    return std::find(channels.begin(), channels.end(), name) != channels.end();
  };
  if (!wanted.empty() && has(wanted)) return wanted;
  if (wanted.empty()) {
    for (const char* name : {"range", "Z", "depth", "Y"})
      if (has(name)) return name;
    if (channels.size() == 1) return channels.front();
  }
  std::string list;
  for (const std::string& name : channels) list += (list.empty() ? "" : ", ") + name;
  const std::string problem = wanted.empty() ? "none of range, Z, depth, Y" : "there is no channel '" + wanted + "'";
  source.refuse("range.channel", problem + "; the file has " + (list.empty() ? "no channels" : list));
}

Image<float> read_exr_range(const Source& source, const std::string& wanted_channel) {
  return with_reader(source, [&](Reader& reader) {
    const std::string channel = choose_range_channel(source, reader.channels(), wanted_channel);
    Image<float> values(reader.size().width, reader.size().height);
    reader.read({channel}, values.pixels.data());
    return values;
  });
}

ColorImage read_exr_color(const Source& source) {
  return with_reader(source, [&](Reader& reader) {
    const bool has_rgb = reader.has("R") && reader.has("G") && reader.has("B");
    if (!has_rgb && !reader.has("Y")) source.refuse("color", "the EXR file has no channels R, G, B");
    const std::vector<std::string> names =
        has_rgb ? std::vector<std::string>{"R", "G", "B"} : std::vector<std::string>{"Y"};
    ColorImage image(reader.size().width, reader.size().height);
    std::vector<float> linear(image.size() * names.size());
    reader.read(names, linear.data());
    for (std::size_t i = 0; i < image.size(); ++i) {
      const float* pixel = linear.data() + i * names.size();
      image.pixels[i] = has_rgb ? Rgb8{to_srgb8(pixel[0]), to_srgb8(pixel[1]), to_srgb8(pixel[2])}
                                : Rgb8{to_srgb8(pixel[0]), to_srgb8(pixel[0]), to_srgb8(pixel[0])};
    }
    return image;
  });
}

MeasuredGridSensor read_exr_measured_grid(const Source& source) {
  return with_reader(source, [&](Reader& reader) {
    MeasuredGridSensor sensor = read_measured_grid_attributes(source, reader.header(), reader.size());
    if (!reader.has(kWarpUChannel) || !reader.has(kWarpVChannel))
      source.refuse(kWarpUChannel, "missing; a measured grid needs its warp");
    sensor.warp = read_warp(source, reader);
    return sensor;
  });
}

void write_range_exr(const std::filesystem::path& file, const RangeImage& range, const Sensor& sensor,
                     const Eigen::Isometry3d& T_world_view, const ColorImage* color) {
  check_writable(file, range, sensor, color);
  MemoryStream stream;
  try {
    Imf::Header header(range.width, range.height);
    header.compression() = Imf::ZIP_COMPRESSION;
    write_attributes(sensor, T_world_view, header);
    Imf::FrameBuffer buffer;
    const char* channel =
        std::holds_alternative<PinholeSensor>(sensor) || std::holds_alternative<OrthographicSensor>(sensor) ? "Z"
                                                                                                            : "range";
    header.channels().insert(channel, Imf::Channel(Imf::FLOAT));
    buffer.insert(channel, slice_of(Imf::FLOAT, range.pixels.data(), sizeof(float), range.width));
    if (const auto* warp = warp_of(sensor)) add_warp(*warp, range.width, header, buffer);
    const std::vector<half> linear = color ? to_linear_halves(*color) : std::vector<half>();
    for (std::size_t i = 0; color && i < 3; ++i) {
      const char* name = std::array{"R", "G", "B"}[i];
      header.channels().insert(name, Imf::Channel(Imf::HALF));
      buffer.insert(name, slice_of(Imf::HALF, linear.data() + i, 3 * sizeof(half), range.width));
    }
    Imf::OutputFile output(stream, header, 0);
    output.setFrameBuffer(buffer);
    output.writePixels(range.height);
  } catch (const std::exception& error) {
    throw IoError(file, "cannot encode EXR: " + one_line(error.what()));
  }
  OutputFile output(file);
  output.write(stream.bytes().data(), stream.bytes().size());
  output.commit();
}

}  // namespace lapseam
