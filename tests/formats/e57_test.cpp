#include "io/e57/e57.h"

#include <cstring>

#include "core/crc32c.h"
#include "io/e57/paged_file.h"
#include "io/page_codec.h"
#include "room_scene.h"

namespace lapseam::test {
namespace {

// ---- files made by hand, so that the reader is not tested against the writer alone

/// A file with these sections, one after another from logical offset 48, and this XML; `@N` in the XML becomes the
/// physical offset of section N.
std::string make_e57(const std::vector<std::string>& sections, std::string xml) {
  std::string logical(48, '\0');
  std::vector<std::uint64_t> offsets;
  for (const std::string& section : sections) {
    logical.resize((logical.size() + 3) / 4 * 4, '\0');
    offsets.push_back(to_physical(logical.size()));
    logical += section;
    // The third word of a CompressedVector section is where its data are: right behind its header.
    const std::uint64_t data = to_physical(logical.size() - section.size() + 32);
    if (section[0] == 1) std::memcpy(logical.data() + logical.size() - section.size() + 16, &data, sizeof data);
  }
  for (std::size_t i = 0; i < offsets.size(); ++i)
    for (std::size_t at; (at = xml.find("@" + std::to_string(i))) != std::string::npos;)
      xml.replace(at, 2, std::to_string(offsets[i]));
  const std::uint64_t xml_offset = to_physical(logical.size()), xml_bytes = xml.size(), page_bytes = kE57PageBytes;
  logical += xml;
  logical.resize((logical.size() + 1019) / 1020 * 1020, '\0');
  const std::uint64_t file_bytes = logical.size() / 1020 * 1024;
  const std::uint32_t version[2] = {1, 0};
  std::memcpy(logical.data(), "ASTM-E57", 8);
  std::memcpy(logical.data() + 8, version, 8);
  std::memcpy(logical.data() + 16, &file_bytes, 8);
  std::memcpy(logical.data() + 24, &xml_offset, 8);
  std::memcpy(logical.data() + 32, &xml_bytes, 8);
  std::memcpy(logical.data() + 40, &page_bytes, 8);
  std::string file;
  for (std::size_t at = 0; at < logical.size(); at += 1020) {
    const std::uint32_t crc = __builtin_bswap32(crc32c(logical.data() + at, 1020));
    file += logical.substr(at, 1020);
    file.append(reinterpret_cast<const char*>(&crc), 4);
  }
  return file;
}

std::string root(const std::string& data3d, const std::string& images2d = "") {
  return "<?xml version=\"1.0\"?><e57Root type=\"Structure\"><data3D type=\"Vector\">" + data3d +
         "</data3D><images2D type=\"Vector\">" + images2d + "</images2D></e57Root>";
}

std::string section_of(const std::vector<std::string>& streams) {
  std::string packet("\1\0\0\0", 4);
  const auto append = [&](std::size_t value) {
    packet += char(value & 0xFF);
    packet += char(value >> 8);
  };
  append(streams.size());
  for (const std::string& stream : streams) append(stream.size());
  for (const std::string& stream : streams) packet += stream;
  packet.resize((packet.size() + 3) / 4 * 4, '\0');
  packet[2] = char((packet.size() - 1) & 0xFF);
  packet[3] = char((packet.size() - 1) >> 8);
  std::string section(32, '\0');
  section[0] = 1;
  const std::uint64_t bytes = 32 + packet.size();
  std::memcpy(section.data() + 8, &bytes, 8);
  return section + packet;
}

/// Numbers of `bits` bits, the lowest first.
std::string packed(const std::vector<std::uint64_t>& values, int bits) {
  std::string bytes;
  std::size_t count = 0;
  for (const std::uint64_t value : values) {
    for (int bit = 0; bit < bits; ++bit, ++count) {
      if (count % 8 == 0) bytes += '\0';
      bytes.back() = char(std::uint8_t(bytes.back()) | std::uint8_t((value >> bit & 1) << count % 8));
    }
  }
  return bytes;
}

std::string doubles(const std::vector<double>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(double)};
}

/// A polar grid of 8 rows and 6 columns, 2 m away; azimuth and elevation in bits of 12, 0.001 rad each.
struct HandMade {
  std::string prototype =
      "<sphericalRange type=\"Float\"/>"
      "<sphericalAzimuth type=\"ScaledInteger\" minimum=\"-100\" maximum=\"3995\" scale=\"0.001\" offset=\"0.5\"/>"
      "<sphericalElevation type=\"ScaledInteger\" minimum=\"-100\" maximum=\"3995\" scale=\"0.001\"/>"
      "<rowIndex type=\"Integer\" minimum=\"0\" maximum=\"7\"/><columnIndex type=\"Integer\" minimum=\"0\" "
      "maximum=\"5\"/>"
      "<returnIndex type=\"Integer\" minimum=\"0\" maximum=\"0\"/>"
      "<sphericalInvalidState type=\"Integer\" minimum=\"0\" maximum=\"2\"/>"
      "<intensity type=\"Integer\" minimum=\"0\" maximum=\"1023\"/>";
  std::vector<double> range;
  std::vector<std::uint64_t> azimuth, elevation, row, column, state, intensity;

  HandMade() {
    for (std::uint64_t u = 0; u < 6; ++u) {
      for (std::uint64_t v = 0; v < 8; ++v) {
        range.push_back(2.0);
        azimuth.push_back(100 + 20 * u);
        elevation.push_back(100 + 300 - 25 * v);
        row.push_back(v);
        column.push_back(u);
        state.push_back(0);
        intensity.push_back(u * 100);
      }
    }
  }

  std::string xml(const std::string& count = "48", const std::string& more = "") const {
    return root(
        "<vectorChild type=\"Structure\"><guid type=\"String\">{1}</guid><name type=\"String\"><![CDATA[a < "
        "b]]></name>" +
        more + "<points type=\"CompressedVector\" fileOffset=\"@0\" recordCount=\"" + count +
        "\"><prototype type=\"Structure\">" + prototype + "</prototype></points></vectorChild>");
  }
  std::string section() const {
    return section_of({doubles(range), packed(azimuth, 12), packed(elevation, 12), packed(row, 3), packed(column, 3),
                       "", packed(state, 2), packed(intensity, 10)});
  }
  std::string file() const { return make_e57({section()}, xml()); }
};

TEST(E57, ChecksumOfTheStandardsExample) {
  // RFC 3720, B.4: 32 bytes of zeros, and of ones.
  EXPECT_EQ(crc32c(std::string(32, '\0').data(), 32), 0x8A9136AAu);
  EXPECT_EQ(crc32c(std::string(32, '\xFF').data(), 32), 0x62A8AB43u);
}

TEST(E57, FieldsOfAllKinds) {
  const TempFolder folder;
  Context context(1);
  HandMade made;
  made.state[5] = 1;
  made.state[6] = 2;
  made.range[7] = -1;
  made.range[8] = 0;
  made.range[9] = std::numeric_limits<double>::infinity();
  made.row[11] = made.row[10];  // a second return
  write_bytes(folder / "a.e57", make_e57({made.section()}, made.xml("48",
                                                                    "<pose type=\"Structure\"><translation "
                                                                    "type=\"Structure\"><y type=\"Float\">3</y>"
                                                                    "</translation></pose>")));
  const Scene scene = read_scene(folder / "a.e57", {}, context);
  ASSERT_EQ(scene.views.size(), 1u);
  EXPECT_EQ(scene.views[0].name, "a < b");
  EXPECT_EQ(scene.views[0].T_world_view.translation(), Eigen::Vector3d(0, 3, 0));
  const View view = load_view(scene.views[0]);
  const auto& sensor = std::get<SphericalSensor>(view.sensor);
  ASSERT_EQ(sensor.columns(), 6);
  ASSERT_EQ(sensor.rows(), 8);
  EXPECT_NEAR(sensor.azimuth_rad[3], 0.5 + 0.06, 1e-15);
  EXPECT_NEAR(sensor.elevation_rad[2], 0.25, 1e-15);
  EXPECT_EQ(view.range.at(4, 4), 2.0f);
  EXPECT_EQ(view.missing.flagged, 2u);
  EXPECT_EQ(view.missing.negative, 1u);
  EXPECT_EQ(view.missing.zero, 1u);
  EXPECT_EQ(view.missing.not_finite, 1u);
  EXPECT_EQ(view.missing.surplus, 1u);
  EXPECT_EQ(view.missing.absent, 1u);
  // Intensity 300 of 1023 is a grey.
  EXPECT_EQ(load_color(scene.views[0]).at(3, 0), (Rgb8{75, 75, 75}));
  EXPECT_EQ(view.intensity.at(3, 0), 75);
  EXPECT_EQ(view.intensity.at(0, 5), 0);  // flagged: no sample
}

TEST(E57, NumbersOfAnyWidthAreUnpackedAcrossBytes) {
  const TempFolder folder;
  Context context(1);
  for (const int bits : {1, 7, 8, 13, 31, 32, 33, 57, 58, 63, 64}) {
    HandMade made;
    const std::uint64_t largest = bits == 64 ? ~std::uint64_t(0) : (std::uint64_t(1) << bits) - 1;
    std::string limits = "minimum=\"0\" maximum=\"" + std::to_string(largest) + "\"";
    if (bits >= 63) limits = bits == 64 ? "" : "minimum=\"0\" maximum=\"9223372036854775807\"";
    made.prototype.replace(made.prototype.find("minimum=\"0\" maximum=\"1023\""), 26, limits);
    made.intensity.assign(48, 0);
    for (std::size_t i = 0; i < 48; i += 2) made.intensity[i] = bits == 64 ? largest : largest;
    write_bytes(folder / "a.e57",
                make_e57({section_of({doubles(made.range), packed(made.azimuth, 12), packed(made.elevation, 12),
                                      packed(made.row, 3), packed(made.column, 3), "", packed(made.state, 2),
                                      packed(made.intensity, bits)})},
                         made.xml()));
    const ColorImage color = load_color(read_scene(folder / "a.e57", {}, context).views[0]);
    for (int v = 0; v < 8; ++v) EXPECT_EQ(color.at(2, v).g, v % 2 ? 0 : 255) << bits << ' ' << v;
  }
}

TEST(E57, RoundTripOfScannersAndCameras) {
  const TempFolder folder;
  Context context(2);
  // Ranges are bitwise; a pixel's angles are doubles.
  expect_round_trip(room_scene(small_scanner(), 3), SceneFormat::kE57, "room.e57", 1e-12);
  expect_round_trip(room_scene(small_scanner(), 1, false), SceneFormat::kE57, "room.e57", 1e-12);
  // x and y are doubles, z a float as it was; the camera is fitted to them.
  expect_round_trip(room_scene(lens_camera(), 2), SceneFormat::kE57, "room.e57", 1e-9);
  // Far from the origin of the world, poses are doubles still.
  expect_round_trip(room_scene(small_scanner(), 2, true, {4567890.125, 5432109.5, 300.25}), SceneFormat::kE57,
                    "room.e57", 1e-12);
}

TEST(E57, RangesComeBackToTheLastBit) {
  const TempFolder folder;
  Context context(2);
  for (const Sensor& sensor : {Sensor(small_scanner()), Sensor(lens_camera())}) {
    const Scene scene = room_scene(sensor, 2);
    convert_scene(scene, folder / "room.e57", {.format = SceneFormat::kE57}, context);
    const Scene back = read_scene(folder / "room.e57", {}, context);
    for (std::size_t i = 0; i < 2; ++i)
      EXPECT_EQ(load_view(back.views[i]).range.pixels, load_view(scene.views[i]).range.pixels);
  }
}

TEST(E57, LargeScansAreReadInPiecesAndTheSameForAnyThreads) {
  const TempFolder folder;
  allow_threads(8);
  const auto scanner = SphericalSensor::from_limits(1024, 640, 3.1, -3.1, 1.2, -0.9);
  Scene scene = room_scene(scanner, 1, false);
  Context context(2);
  convert_scene(scene, folder / "a.e57", {.format = SceneFormat::kE57}, context);
  EXPECT_GT(open_e57_scan({folder / "a.e57", {}}, 0, std::nullopt, &context)->pieces(), 1u);
  for (const int threads : {1, 2, 8}) {
    Context other(threads);
    const Scene back = read_scene(folder / "a.e57", {}, other);
    const auto& found = std::get<SphericalSensor>(*back.views[0].sensor);
    EXPECT_EQ(found.azimuth_rad, scanner.azimuth_rad);
    EXPECT_EQ(found.elevation_rad, scanner.elevation_rad);
    EXPECT_FALSE(found.warp);
    EXPECT_EQ(load_view(back.views[0]).range.pixels, scene.views[0].range.memory->pixels);
  }
}

TEST(E57, AnImageOfAnotherCameraIsAView) {
  const TempFolder folder;
  Context context(1);
  Scene scene = room_scene(small_scanner(), 1, false);
  ColorSource& color = scene.views[0].color.emplace();
  color.camera = PinholeSensor{80, 60, 70.5, 71.5, 41.25, 29.75, {}};
  color.T_view_color = odd_pose(3);
  color.memory = std::make_shared<ColorImage>(80, 60, Rgb8{200, 100, 50});
  convert_scene(scene, folder / "room.e57", {.format = SceneFormat::kE57}, context);
  const Scene back = read_scene(folder / "room.e57", {}, context);
  ASSERT_TRUE(back.views[0].color);
  EXPECT_TRUE(back.views[0].color->T_view_color.isApprox(color.T_view_color, 1e-12));
  const auto& camera = std::get<PinholeSensor>(back.views[0].color->camera);
  EXPECT_NEAR(camera.fx, 70.5, 1e-12);
  EXPECT_NEAR(camera.cy, 29.75, 1e-12);
  const Rgb8 pixel = load_color(back.views[0]).at(40, 30);
  EXPECT_NEAR(pixel.r, 200, 4);  // JPEG
  EXPECT_NEAR(pixel.b, 50, 4);
}

std::string text_of(const ColorImage& image) {
  const std::vector<char> jpeg = encode_jpeg(image, 95);
  return std::string(16, '\0') + std::string(jpeg.begin(), jpeg.end());
}

/// An Image2D whose JPEG is section N of the file.
std::string image2d(const std::string& kind, int section, std::size_t bytes, const std::string& numbers) {
  return "<vectorChild type=\"Structure\"><pose type=\"Structure\"/><" + kind +
         " type=\"Structure\"><jpegImage type=\"Blob\" fileOffset=\"@" + std::to_string(section) + "\" length=\"" +
         std::to_string(bytes) + "\"/>" + numbers + "</" + kind + "></vectorChild>";
}

std::string number(const std::string& name, double value) {
  return "<" + name + " type=\"Float\">" + std::to_string(value) + "</" + name + ">";
}

TEST(E57, CylindersAndAllFurtherImagesAreColours) {
  const TempFolder folder;
  Context context(1);
  const HandMade made;
  const std::string cylinder = text_of(ColorImage(40, 20, Rgb8{200, 100, 50}));
  const std::string front = text_of(ColorImage(30, 20, Rgb8{10, 200, 20}));
  const std::string size = number("imageWidth", 40) + number("imageHeight", 20);
  const std::string images =
      image2d("pinholeRepresentation", 2, front.size() - 16,
              number("imageWidth", 30) + number("imageHeight", 20) + number("focalLength", 0.01) +
                  number("pixelWidth", 0.001) + number("pixelHeight", 0.001) + number("principalPointX", 15) +
                  number("principalPointY", 10)) +
      image2d("cylindricalRepresentation", 1, cylinder.size() - 16,
              size + number("pixelWidth", 0.1) + number("pixelHeight", 0.2) + number("radius", 2) +
                  number("principalPointY", 5));
  std::string xml = made.xml();
  xml.replace(xml.find("<images2D type=\"Vector\">"), 24, "<images2D type=\"Vector\">" + images);
  write_bytes(folder / "a.e57", make_e57({made.section(), cylinder, front}, xml));
  const Scene scene = read_scene(folder / "a.e57", {}, context);
  ASSERT_TRUE(scene.views[0].color);
  const auto& sensor = std::get<SphericalSensor>(scene.views[0].color->camera);
  EXPECT_EQ(load_color(scene.views[0]).width, 40);
  EXPECT_NEAR(load_color(scene.views[0]).at(5, 5).r, 200, 4);
  // A point on the cylinder, 2 m away and 0.7 m up: 3.5 rows over the principal point; 0.55 rad to the left.
  PixelRange pixel;
  ASSERT_TRUE(sensor.project({2 * std::cos(0.55), 2 * std::sin(0.55), 0.7}, pixel));
  EXPECT_NEAR(pixel.u, 14, 1e-6);
  EXPECT_NEAR(pixel.v, 1, 1e-6);
  ASSERT_EQ(scene.views[0].more_colors.size(), 1u);
  EXPECT_TRUE(std::holds_alternative<PinholeSensor>(scene.views[0].more_colors[0].camera));
  ViewSource other = scene.views[0];
  other.color = other.more_colors[0];
  EXPECT_NEAR(load_color(other).at(3, 3).g, 200, 4);
  // Without a radius it is none; then the intensities come first.
  for (const std::string tag : {"<radius", "</radius"})
    xml.replace(xml.find(tag), tag.size(), tag[1] == '/' ? "</other" : "<other");
  write_bytes(folder / "b.e57", make_e57({made.section(), cylinder, front}, xml));
  EXPECT_TRUE(read_scene(folder / "b.e57", {}, context).views[0].color->index < kImageOfFile);
}

TEST(E57, ScansWithoutRowsButWithAPoseAreGridded) {
  const TempFolder folder;
  Context context(1);
  HandMade made;
  made.prototype.replace(made.prototype.find("rowIndex"), 8, "nothing1");
  const std::string section = made.section();
  write_bytes(folder / "a.e57", make_e57({section}, made.xml()));
  expect_refused([&] { read_scene(folder / "a.e57", {}, context); }, {"a.e57", "'a < b'", "neither rows", "pose"});
  write_bytes(folder / "a.e57", make_e57({section}, made.xml("48", "<pose type=\"Structure\"/>")));
  const View view = load_view(read_scene(folder / "a.e57", {}, context).views[0]);
  std::size_t samples = 0;
  for (const float r : view.range.pixels) samples += r > 0;
  EXPECT_EQ(samples + view.missing.surplus, 48u);
  EXPECT_GE(samples, 40u);  // the grid is guessed from these few points
}

TEST(E57, HostileFiles) {
  const TempFolder folder;
  Context context(1);
  const HandMade made;
  const std::string good = made.file();
  const auto expect_bad = [&](const std::string& bytes, std::initializer_list<std::string> words) {
    write_bytes(folder / "b.e57", bytes);
    expect_refused([&] { load_view(read_scene(folder / "b.e57", {}, context).views.at(0)); }, words);
  };
  for (std::size_t at : {100u, 1023u, 1500u}) {
    std::string bad = good;
    bad[at] = char(bad[at] ^ 1);
    expect_bad(bad, {"b.e57", at < 1024 ? "page 0" : "page 1", "checksum"});
  }
  expect_bad(good.substr(0, 1024), {"b.e57", "filePhysicalLength", "truncated"});
  expect_bad(good.substr(0, 60), {"b.e57", "shorter"});
  const auto remade = [&](const std::string& from, const std::string& to) {
    std::string xml = made.xml();
    xml.replace(xml.find(from), from.size(), to);
    return make_e57({made.section()}, xml);
  };
  expect_bad(remade("recordCount=\"48\"", "recordCount=\"4800000000000\""), {"recordCount", "more than"});
  expect_bad(remade("recordCount=\"48\"", "recordCount=\"49\""), {"b.e57"});
  expect_bad(remade("recordCount=\"48\"", "recordCount=\"-1\""), {"recordCount"});
  expect_bad(remade("recordCount=\"48\"", "recordCount=\"0\""), {"no points"});
  expect_bad(remade("fileOffset=\"@0\"", "fileOffset=\"99999999999\""), {"beyond the end"});
  expect_bad(remade("fileOffset=\"@0\"", "fileOffset=\"64\""), {"b.e57"});
  expect_bad(remade("scale=\"0.001\"", "scale=\"x\""), {"scale", "'x'"});
  expect_bad(remade("minimum=\"-100\" maximum=\"3995\"", "minimum=\"5000\" maximum=\"3995\""), {"minimum"});
  expect_bad(remade("sphericalRange", "cartesianX"), {"prototype", "neither"});
  expect_bad(remade("<prototype", "<prototipe"), {"XML"});
  expect_bad(remade("maximum=\"7\"", "maximum=\"2147483647\""), {"b.e57"});
  expect_bad(make_e57({}, root("")), {"b.e57", "data3D", "empty"});
  expect_bad(make_e57({}, root("", "<vectorChild type=\"Structure\"/>")), {"1 images and no scan"});
  expect_bad(make_e57({}, "<a/>"), {"e57Root"});
  HandMade far_apart;
  const std::string rows = "rowIndex type=\"Integer\" minimum=\"0\" maximum=\"7\"";
  far_apart.prototype.replace(far_apart.prototype.find(rows), rows.size(),
                              "rowIndex type=\"Integer\" minimum=\"2000000000\" maximum=\"2000000007\"");
  expect_bad(far_apart.file(), {"indexBounds", "for 48 points"});
  // Cut at every 97th byte, with checksums mended: nothing but a refusal may come of it.
  const std::string section = made.section();
  for (std::size_t length = 33; length < section.size(); length += 97) {
    write_bytes(folder / "b.e57", make_e57({section.substr(0, length)}, made.xml()));
    expect_refused([&] { load_view(read_scene(folder / "b.e57", {}, context).views.at(0)); }, {"b.e57"});
  }
}

// ---- the shared files; docs/formats.md has the same table

struct Expectation {
  const char* file;
  const char* refusal;  ///< null: it is read
};

TEST(E57, SharedFilesAreReadOrRefusedInOneLine) {
  const std::filesystem::path data = data_folder();
  if (data.empty()) GTEST_SKIP() << "no real scans: set LAPSEAM_DATA";
  Context context(1);
  const Expectation expectations[] = {
      {"A4.e57", "neither rows and columns nor a pose"},
      {"A4_moved.e57", "neither rows and columns nor a pose"},
      {"A_B.e57", "neither rows and columns nor a pose"},
      {"A_B_different_dims.e57", "neither rows and columns nor a pose"},
      {"A_merged_B.e57", "neither rows and columns nor a pose"},
      {"A_moved_B.e57", "neither rows and columns nor a pose"},
      {"B2.e57", "neither rows and columns nor a pose"},
      {"ColourRepresentation.e57", "neither rows and columns nor a pose"},
      {"ColouredCubeDouble.e57", "neither rows and columns nor a pose"},
      {"ColouredCubeFloat.e57", "neither rows and columns nor a pose"},
      {"InvalidCVHeader.e57", "the scan has no points"},
      {"PinholeImageWithDistortionParameters.e57", "3 images and no scan"},
      {"ZeroPoints.e57", "the scan has no points"},
      {"ZeroPointsInvalid.e57", "the scan has no points"},
      {"bad-crc.e57", "page 0: the checksum is wrong"},
      {"bunnyDouble.e57", "neither rows and columns nor a pose"},
      {"bunnyInt32.e57", "neither rows and columns nor a pose"},
      {"empty.e57", "the file is empty"},
      {"pumpAVisualReferenceImage.e57", nullptr},
      {"test filename äöü.e57", "the file is empty"},
      {"testWithNormals.e57", "neither rows and columns nor a pose"},
      {"translationWithoutRotation.e57", "3 valid samples"},
      {"测试点云.e57", "the file is empty"},
  };
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(data / "e57"))
    files += entry.path().extension() == ".e57";
  EXPECT_EQ(files, std::size(expectations));
  for (const Expectation& expected : expectations) {
    const std::filesystem::path file = data / "e57" / expected.file;
    SCOPED_TRACE(expected.file);
    if (expected.refusal) {
      expect_refused([&] { read_scene(file, {}, context); }, {expected.file, expected.refusal});
      continue;
    }
    const Scene scene = read_scene(file, {}, context);
    ASSERT_EQ(scene.views.size(), 1u);
    const View view = load_view(scene.views[0]);
    EXPECT_EQ(view.range.width, 345);
    EXPECT_EQ(view.range.height, 1074);
    std::uint64_t samples = 0;
    for (const float r : view.range.pixels) samples += r > 0;
    EXPECT_EQ(samples + view.missing.surplus + view.missing.flagged, 155201u);
    EXPECT_GT(samples, 155000u);
    EXPECT_EQ(load_color(scene.views[0]).width, 345);
  }
}

}  // namespace
}  // namespace lapseam::test
