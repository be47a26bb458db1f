// E57, writing: spherical sensors as azimuth, elevation (doubles) and range (float), others as x, y (doubles) and z
// (float), so that ranges come back to the last bit. Every scan has rows, columns, its pose, and, where the colour
// image is registered to the ranges, colours. Other colour images become Image2D entries.

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <numbers>
#include <utility>

#include "core/xml.h"
#include "core/crc32c.h"
#include "io/e57/paged_file.h"
#include "io/number_text.h"
#include "io/output_file.h"
#include "io/page_codec.h"
#include "io/scene_writer.h"

namespace lapseam {
namespace {

/// Pages with their checksums, one after another; the first is kept back for the header, which is known last.
class PagedOutput {
 public:
  explicit PagedOutput(OutputFile& out) : out_(out) { write(std::string(48, '\0')); }

  void write(std::string_view bytes) {
    while (!bytes.empty()) {
      const std::size_t piece = std::min(bytes.size(), kE57PayloadBytes - page_.size());
      page_.append(bytes.substr(0, piece));
      bytes.remove_prefix(piece);
      if (page_.size() == kE57PayloadBytes) flush();
    }
  }
  template <typename T>
  void put(const T& value) {
    write({reinterpret_cast<const char*>(&value), sizeof value});
  }
  /// Sections begin at multiples of four.
  void align() { write(std::string((4 - logical() % 4) % 4, '\0')); }
  std::uint64_t logical() const { return pages_ * kE57PayloadBytes + page_.size(); }
  std::uint64_t physical() const { return to_physical(logical()); }

  void finish(std::uint64_t xml_offset, std::uint64_t xml_bytes) {
    if (!page_.empty()) {
      page_.resize(kE57PayloadBytes, '\0');
      flush();
    }
    struct {
      char signature[8] = {'A', 'S', 'T', 'M', '-', 'E', '5', '7'};
      std::uint32_t major = 1, minor = 0;
      std::uint64_t file_bytes, xml_offset, xml_bytes, page_bytes = kE57PageBytes;
    } header;
    header.file_bytes = pages_ * kE57PageBytes;
    header.xml_offset = xml_offset;
    header.xml_bytes = xml_bytes;
    std::memcpy(first_.data(), &header, sizeof header);
    out_.overwrite(0, with_checksum(first_));
  }

 private:
  static std::string with_checksum(std::string page) {
    const std::uint32_t crc = __builtin_bswap32(crc32c(page.data(), page.size()));
    page.append(reinterpret_cast<const char*>(&crc), sizeof crc);
    return page;
  }

  void flush() {
    if (pages_ == 0) first_ = page_;
    out_.write(with_checksum(std::move(page_)));
    page_.clear();
    ++pages_;
  }

  OutputFile& out_;
  std::string page_, first_;
  std::uint64_t pages_ = 0;
};

/// Packs numbers of a fixed number of bits, the lowest first.
class BitPacker {
 public:
  explicit BitPacker(int bits) : bits_(bits) {}
  void add(std::uint64_t value) {
    held_ |= value << count_;
    count_ += bits_;
    for (; count_ >= 8; count_ -= 8, held_ >>= 8) bytes_ += char(held_ & 0xFF);
  }
  std::string take() {
    if (count_ > 0) bytes_ += char(held_ & 0xFF);
    held_ = 0;
    count_ = 0;
    return std::exchange(bytes_, {});
  }

 private:
  int bits_, count_ = 0;
  std::uint64_t held_ = 0;
  std::string bytes_;
};

class Xml {
 public:
  void open(const std::string& name, const std::string& attributes) { text += "<" + name + " " + attributes + ">"; }
  void close(const std::string& name) { text += "</" + name + ">\n"; }
  void structure(const std::string& name) { open(name, "type=\"Structure\""); }
  void string(const std::string& name, std::string_view value) {
    text += "<" + name + " type=\"String\">" + escape_xml(value) + "</" + name + ">\n";
  }
  void integer(const std::string& name, std::int64_t value) {
    text += "<" + name + " type=\"Integer\">" + std::to_string(value) + "</" + name + ">\n";
  }
  void real(const std::string& name, double value) {
    text += "<" + name + " type=\"Float\">" + number_text(value) + "</" + name + ">\n";
  }
  void pose(const Eigen::Isometry3d& T) {
    const Eigen::Quaterniond q(T.linear());
    structure("pose");
    structure("rotation");
    for (const auto& [name, value] : {std::pair{"w", q.w()}, {"x", q.x()}, {"y", q.y()}, {"z", q.z()}})
      real(name, value);
    close("rotation");
    structure("translation");
    for (int axis = 0; axis < 3; ++axis) real(std::array{"x", "y", "z"}[std::size_t(axis)], T.translation()[axis]);
    close("translation");
    close("pose");
  }

  std::string text;
};

/// The same scene gives the same file, so identifiers come from what they identify (FNV-1a, 1991).
std::string guid_of(std::string_view kind, std::string_view name, std::size_t index) {
  std::uint64_t hash = 14695981039346656037u;
  for (const char c : std::string(kind) + "/" + std::string(name) + "/" + std::to_string(index))
    hash = (hash ^ std::uint8_t(c)) * 1099511628211u;
  char text[64];
  std::snprintf(text, sizeof text, "{%08x-%04x-4%03x-8000-%012llx}", unsigned(hash >> 32),
                unsigned(hash >> 16 & 0xFFFF), unsigned(hash & 0xFFF), static_cast<unsigned long long>(index));
  return text;
}

constexpr std::size_t kRecordsPerPacket = 1024;  // a multiple of 8, so that every stream ends with a whole byte

class E57Writer : public SceneWriter {
 public:
  explicit E57Writer(const std::filesystem::path& file) : file_(file), out_(file), pages_(out_) {}

  void add(const LoadedView& loaded) override {
    const bool is_registered = has_registered_color(loaded);
    add_scan(loaded, is_registered);
    if (loaded.color && !is_registered) add_image(loaded);
    ++count_;
  }

  void finish() override {
    Xml xml;
    xml.text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
    xml.open("e57Root", "type=\"Structure\" xmlns=\"http://www.astm.org/COMMIT/E57/2010-e57-v1.0\"");
    xml.string("formatName", "ASTM E57 3D Imaging Data File");
    xml.string("guid", guid_of("file", file_.stem().string(), count_));
    xml.integer("versionMajor", 1);
    xml.integer("versionMinor", 0);
    xml.string("e57LibraryVersion", "lapseam");
    xml.open("data3D", "type=\"Vector\" allowHeterogeneousChildren=\"1\"");
    xml.text += scans_.text;
    xml.close("data3D");
    xml.open("images2D", "type=\"Vector\" allowHeterogeneousChildren=\"1\"");
    xml.text += images_.text;
    xml.close("images2D");
    xml.close("e57Root");
    pages_.align();
    const std::uint64_t offset = pages_.physical();
    pages_.write(xml.text);
    pages_.finish(offset, xml.text.size());
    out_.commit();
  }

 private:
  struct Packers {
    Packers(int width, int height)
        : column(std::bit_width(unsigned(width - 1))), row(std::bit_width(unsigned(height - 1))) {}
    std::string a, b, r, red, green, blue;
    BitPacker column, row;
  };

  void add_scan(const LoadedView& loaded, bool has_color) {
    const View& view = loaded.view;
    const auto samples =
        std::uint64_t(std::count_if(view.range.pixels.begin(), view.range.pixels.end(), [](float r) { return r > 0; }));
    const std::uint64_t offset = write_points(view, has_color ? &*loaded.color : nullptr, samples);
    describe_scan(loaded, has_color, samples, offset);
  }

  std::uint64_t write_points(const View& view, const ColorImage* color, std::uint64_t samples) {
    pages_.align();
    const std::uint64_t begin = pages_.physical(), begin_logical = pages_.logical();
    const std::string packets = make_packets(view, color);
    constexpr std::uint64_t kHeaderBytes = 32, kIndexBytes = 32;
    const std::uint64_t data = to_physical(begin_logical + kHeaderBytes);
    pages_.put(std::uint64_t(1));  // section identifier, and seven bytes of nothing
    pages_.put(kHeaderBytes + packets.size() + kIndexBytes);
    pages_.put(data);
    pages_.put(to_physical(begin_logical + kHeaderBytes + packets.size()));
    pages_.write(packets);
    // The standard wants an index packet; one entry, the first packet, will do.
    pages_.write(std::string_view("\0\0\x1F\0\1\0\0\0\0\0\0\0\0\0\0\0", 16));
    pages_.put(std::uint64_t(0));
    pages_.put(data);
    if (samples == 0) throw InvalidInput(file_, view.name, "range", "there is no valid sample to write");
    return begin;
  }

  static std::string make_packets(const View& view, const ColorImage* color) {
    std::string packets;
    Packers streams(view.range.width, view.range.height);
    const auto* spherical = std::get_if<SphericalSensor>(&view.sensor);
    std::size_t held = 0;
    const auto append = [](std::string& stream, const auto& value) {
      stream.append(reinterpret_cast<const char*>(&value), sizeof value);
    };
    for (int v = 0; v < view.range.height; ++v) {
      for (int u = 0; u < view.range.width; ++u) {
        const float r = view.range.at(u, v);
        if (!(r > 0)) continue;
        const Eigen::Vector3d p = unproject(view.sensor, u, v, double(r));
        if (spherical) {
          append(streams.a, azimuth(*spherical, u, p));
          append(streams.b, spherical->warp ? std::atan2(p.z(), std::hypot(p.x(), p.y()))
                                            : spherical->elevation_rad[std::size_t(v)]);
          append(streams.r, r);
        } else {
          append(streams.a, p.x());
          append(streams.b, p.y());
          append(streams.r, float(p.z()));
        }
        streams.row.add(std::uint64_t(v));
        streams.column.add(std::uint64_t(u));
        if (color) {
          const Rgb8 c = color->at(u, v);
          streams.red += char(c.r);
          streams.green += char(c.g);
          streams.blue += char(c.b);
        }
        if (++held == kRecordsPerPacket) flush_packet(streams, color != nullptr, held, packets);
      }
    }
    if (held > 0) flush_packet(streams, color != nullptr, held, packets);
    return packets;
  }

  /// The standard's azimuths run from −π to π; those of a table may go on.
  static double azimuth(const SphericalSensor& sensor, int u, const Eigen::Vector3d& p) {
    const double table = sensor.azimuth_rad[std::size_t(u)];
    return sensor.warp || std::abs(table) > std::numbers::pi ? std::atan2(p.y(), p.x()) : table;
  }

  static void flush_packet(Packers& streams, bool has_color, std::size_t& held, std::string& packets) {
    std::vector<std::string> parts{std::exchange(streams.a, {}), std::exchange(streams.b, {}),
                                   std::exchange(streams.r, {}), streams.row.take(), streams.column.take()};
    if (has_color)
      for (std::string* part : {&streams.red, &streams.green, &streams.blue}) parts.push_back(std::exchange(*part, {}));
    std::string packet("\1\0\0\0", 4);
    const auto append = [&](std::size_t value) {
      packet += char(value & 0xFF);
      packet += char(value >> 8);
    };
    append(parts.size());
    for (const std::string& part : parts) append(part.size());
    for (const std::string& part : parts) packet += part;
    packet.resize((packet.size() + 3) / 4 * 4, '\0');
    const std::size_t length = packet.size() - 1;
    packet[2] = char(length & 0xFF);
    packet[3] = char(length >> 8);
    packets += packet;
    held = 0;
  }

  void describe_scan(const LoadedView& loaded, bool has_color, std::uint64_t samples, std::uint64_t offset) {
    const View& view = loaded.view;
    const int last_row = view.range.height - 1, last_column = view.range.width - 1;
    scans_.structure("vectorChild");
    scans_.string("guid", guid_of("scan", view.name, count_));
    scans_.string("name", view.name);
    scans_.pose(view.T_world_view);
    scans_.structure("indexBounds");
    for (const auto& [name, last] : {std::pair{"row", last_row}, {"column", last_column}, {"return", 0}}) {
      scans_.integer(std::string(name) + "Minimum", 0);
      scans_.integer(std::string(name) + "Maximum", last);
    }
    scans_.close("indexBounds");
    if (has_color) {
      scans_.structure("colorLimits");
      for (const char* name : {"colorRed", "colorGreen", "colorBlue"}) {
        scans_.integer(std::string(name) + "Minimum", 0);
        scans_.integer(std::string(name) + "Maximum", 255);
      }
      scans_.close("colorLimits");
    }
    scans_.open("points", "type=\"CompressedVector\" fileOffset=\"" + std::to_string(offset) + "\" recordCount=\"" +
                              std::to_string(samples) + "\"");
    scans_.structure("prototype");
    const bool is_spherical = std::holds_alternative<SphericalSensor>(view.sensor);
    field(is_spherical ? "sphericalAzimuth" : "cartesianX", "type=\"Float\" precision=\"double\"");
    field(is_spherical ? "sphericalElevation" : "cartesianY", "type=\"Float\" precision=\"double\"");
    field(is_spherical ? "sphericalRange" : "cartesianZ", "type=\"Float\" precision=\"single\"");
    field("rowIndex", integer_type(last_row));
    field("columnIndex", integer_type(last_column));
    for (const char* name : {"colorRed", "colorGreen", "colorBlue"})
      if (has_color) field(name, integer_type(255));
    scans_.close("prototype");
    scans_.text += "<codecs type=\"Vector\" allowHeterogeneousChildren=\"1\"/>";
    scans_.close("points");
    scans_.close("vectorChild");
  }

  void field(const char* name, const std::string& type) {
    scans_.text += "<" + std::string(name) + " " + type + "/>\n";
  }
  static std::string integer_type(int maximum) {
    return "type=\"Integer\" minimum=\"0\" maximum=\"" + std::to_string(maximum) + "\"";
  }

  void add_image(const LoadedView& loaded) {
    const ColorSource& color = *loaded.source.color;
    const auto* pinhole = std::get_if<PinholeSensor>(&color.camera);
    if (!pinhole || !pinhole->distortion.is_zero())
      throw InvalidInput(file_, loaded.view.name, "color.camera",
                         "an E57 file holds images of pinhole cameras without distortion only; convert without colour");
    constexpr int kJpegQuality = 95;
    const std::vector<char> jpeg = encode_jpeg(*loaded.color, kJpegQuality);
    pages_.align();
    const std::uint64_t offset = pages_.physical();
    pages_.put(std::uint64_t(0));
    pages_.put(std::uint64_t(16 + jpeg.size()));
    pages_.write({jpeg.data(), jpeg.size()});
    images_.structure("vectorChild");
    images_.string("guid", guid_of("image", loaded.view.name, count_));
    images_.string("name", loaded.view.name);
    images_.string("associatedData3DGuid", guid_of("scan", loaded.view.name, count_));
    Eigen::Isometry3d T_world_image = loaded.view.T_world_view * color.T_view_color;
    T_world_image.linear() = T_world_image.linear() * Eigen::Vector3d(1, -1, -1).asDiagonal();
    images_.pose(T_world_image);
    images_.structure("pinholeRepresentation");
    images_.text += "<jpegImage type=\"Blob\" fileOffset=\"" + std::to_string(offset) + "\" length=\"" +
                    std::to_string(jpeg.size()) + "\"/>\n";
    images_.integer("imageWidth", pinhole->width);
    images_.integer("imageHeight", pinhole->height);
    // Any focal length would do: only its ratio to the pixels counts. One metre makes the pixels 1/f.
    images_.real("focalLength", 1);
    images_.real("pixelWidth", 1 / pinhole->fx);
    images_.real("pixelHeight", 1 / pinhole->fy);
    images_.real("principalPointX", pinhole->cx + 0.5);
    images_.real("principalPointY", pinhole->cy + 0.5);
    images_.close("pinholeRepresentation");
    images_.close("vectorChild");
  }

  std::filesystem::path file_;
  OutputFile out_;
  PagedOutput pages_;
  Xml scans_, images_;
  std::size_t count_ = 0;
};

}  // namespace

std::unique_ptr<SceneWriter> make_e57_writer(const std::filesystem::path& file) {
  return std::make_unique<E57Writer>(file);
}

}  // namespace lapseam
