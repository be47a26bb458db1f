// Damaged files: nothing crashes, nothing big is allocated, and the message names the file.

#include <cstring>
#include <random>

#include "io/codecs.h"
#include "io/exr.h"
#include "io_support.h"
#include "lapseam/context.h"
#include "lapseam/io.h"

namespace lapseam::test {
namespace {

std::uint32_t crc32(std::string_view bytes) {
  std::uint32_t crc = 0xFFFFFFFFu;
  for (const char c : bytes) {
    crc ^= std::uint8_t(c);
    for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? 0xEDB88320u ^ (crc >> 1) : crc >> 1;
  }
  return ~crc;
}

std::string big_endian(std::uint32_t value) {
  return {char(value >> 24), char(value >> 16), char(value >> 8), char(value)};
}

/// A PNG whose header claims another size, with a right checksum.
std::string with_size(std::string png, std::uint32_t width, std::uint32_t height) {
  png.replace(16, 8, big_endian(width) + big_endian(height));
  png.replace(29, 4, big_endian(crc32(png.substr(12, 17))));
  return png;
}

class HostilePng : public testing::Test {
 protected:
  HostilePng() {
    std::mt19937 random(5);
    Image<std::uint16_t> image(64, 48);
    for (auto& pixel : image.pixels) pixel = std::uint16_t(random());
    write_png16(folder / "a.png", image);
    bytes = read_bytes(folder / "a.png");
  }
  const TempFolder folder;
  std::string bytes;
};

TEST_F(HostilePng, TruncatedAnywhere) {
  for (std::size_t length = 8; length + 12 < bytes.size(); length += 97) {
    write_bytes(folder / "b.png", bytes.substr(0, length));
    expect_refused([&] { read_png16(folder / "b.png"); }, {"b.png"});
  }
}

TEST_F(HostilePng, AbsurdSizes) {
  for (const auto& [width, height] :
       {std::pair(1000000000u, 1000000000u), {0x7FFFFFFFu, 1u}, {32768u, 32768u}, {0u, 5u}}) {
    write_bytes(folder / "b.png", with_size(bytes, width, height));
    expect_refused([&] { read_png16(folder / "b.png"); }, {"b.png"});
    expect_refused([&] { read_color_image(folder / "b.png"); }, {"b.png"});
    expect_refused([&] { probe_png({folder / "b.png", "v"}); }, {"b.png", "'v'", "size"});
  }
}

TEST_F(HostilePng, FlippedBitsAreNoticedByTheChecksum) {
  std::mt19937 random(6);
  for (int trial = 0; trial < 100; ++trial) {
    std::string damaged = bytes;
    damaged[8 + random() % (damaged.size() - 8)] ^= char(1u << random() % 8);
    write_bytes(folder / "b.png", damaged);
    expect_refused([&] { read_png16(folder / "b.png"); }, {"b.png"});
  }
}

class HostileExr : public testing::Test {
 protected:
  HostileExr() {
    std::mt19937 random(5);
    RangeImage range(64, 48);
    for (auto& pixel : range.pixels) pixel = 1.0f + float(random() % 1000) / 500.0f;
    const ColorImage color = make_color(64, 48);
    write_range_exr(folder / "a.exr", range, PinholeSensor{64, 48, 50, 50, 32, 24, {}}, Eigen::Isometry3d::Identity(),
                    &color);
    bytes = read_bytes(folder / "a.exr");
  }

  /// All there is to read in the file.
  void read_all(const std::filesystem::path& file) {
    Context context(1);
    const Scene scene = read_scene(file, {}, context);
    load_view(scene.views[0]);
    if (scene.views[0].color) load_color(scene.views[0]);
  }

  /// Overwrites the data of an attribute; an attribute is name\0 type\0 size data.
  std::string with_attribute(const std::string& name, const std::string& type, const std::string& data) {
    std::string changed = bytes;
    const std::size_t at = changed.find(name + '\0' + type + '\0');
    EXPECT_NE(at, std::string::npos);
    changed.replace(at + name.size() + type.size() + 6, data.size(), data);
    return changed;
  }

  const TempFolder folder;
  std::string bytes;
};

std::string box(std::int32_t x0, std::int32_t y0, std::int32_t x1, std::int32_t y1) {
  const std::int32_t values[4] = {x0, y0, x1, y1};
  std::string text(sizeof values, '\0');
  std::memcpy(text.data(), values, sizeof values);
  return text;
}

TEST_F(HostileExr, TruncatedAnywhere) {
  for (std::size_t length = 8; length < bytes.size(); length += 97) {
    write_bytes(folder / "b.exr", bytes.substr(0, length));
    expect_refused([&] { read_all(folder / "b.exr"); }, {"b.exr"});
  }
}

TEST_F(HostileExr, AbsurdSizes) {
  const std::string boxes[] = {box(0, 0, 999999999, 999999999),
                               box(0, 0, 32767, 32767),
                               box(0, 0, 0x7FFFFFFF, 0),
                               box(-0x7FFFFFFF, -0x7FFFFFFF, 0x7FFFFFFF, 0x7FFFFFFF),
                               box(5, 5, 4, 4),
                               box(0, 0x7FFFFF00, 63, 0x7FFFFF2F)};
  for (const std::string& window : boxes) {
    write_bytes(folder / "b.exr", with_attribute("dataWindow", "box2i", window));
    expect_refused([&] { read_all(folder / "b.exr"); }, {"b.exr"});
  }
}

TEST_F(HostileExr, AnAttributeLongerThanTheFile) {
  std::string changed = bytes;
  const std::string start = std::string("lapseam:sensor") + '\0' + "string" + '\0';
  const std::size_t at = changed.find(start);
  ASSERT_NE(at, std::string::npos);
  for (const char* size : {"\xFF\xFF\xFF\x7F", "\xFF\xFF\xFF\xFF"}) {
    write_bytes(folder / "b.exr", changed.replace(at + start.size(), 4, size, 4));
    expect_refused([&] { read_all(folder / "b.exr"); }, {"b.exr", "lapseam:sensor", "does not fit"});
  }
}

TEST_F(HostileExr, AnAttributeOfTheWrongSizeForItsType) {
  // OpenEXR would go on reading in its middle, and take numbers for sizes.
  for (const std::string& type : {std::string("m44d"), std::string("chlist"), std::string("box2i")}) {
    std::string changed = bytes;
    const std::size_t at = changed.find('\0' + type + '\0') + type.size() + 2;
    changed[at] = char(changed[at] + 8);
    write_bytes(folder / "b.exr", changed);
    expect_refused([&] { read_all(folder / "b.exr"); }, {"b.exr", "size of its type"});
  }
}

TEST_F(HostileExr, NamesWithLineBreaksStayOneLine) {
  std::string changed = bytes;
  const std::string start = std::string("lapseam:sensor") + '\0' + "string" + '\0';
  const std::size_t at = changed.find(start);
  ASSERT_NE(at, std::string::npos);
  changed.replace(at + 15, 3, "a\nb");  // of the type
  write_bytes(folder / "b.exr", changed);
  expect_refused([&] { read_all(folder / "b.exr"); }, {"b.exr", "lapseam:sensor", "a?b"});
}

TEST_F(HostileExr, APoseThatIsNoPose) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::string number(sizeof nan, '\0');
  std::memcpy(number.data(), &nan, sizeof nan);
  write_bytes(folder / "b.exr", with_attribute("lapseam:viewToWorld", "m44d", number));
  expect_refused([&] { read_all(folder / "b.exr"); }, {"b.exr", "'b'", "lapseam:viewToWorld", "not finite"});
  const double two = 2;
  std::memcpy(number.data(), &two, sizeof two);
  write_bytes(folder / "b.exr", with_attribute("lapseam:viewToWorld", "m44d", number));
  expect_refused([&] { read_all(folder / "b.exr"); }, {"b.exr", "'b'", "lapseam:viewToWorld", "not a rigid motion"});
}

TEST_F(HostileExr, FlippedBytesNeverCrash) {
  // EXR has no checksums: some damage goes unnoticed. What is noticed must be said in our own words.
  std::mt19937 random(7);
  int refused = 0;
  for (int trial = 0; trial < 300; ++trial) {
    std::string damaged = bytes;
    for (int i = 0; i < 3; ++i) damaged[8 + random() % (trial % 2 ? 1200 : damaged.size() - 8)] = char(random());
    write_bytes(folder / "b.exr", damaged);
    try {
      read_all(folder / "b.exr");
    } catch (const InvalidInput& error) {
      ++refused;
      EXPECT_NE(std::string(error.what()).find("b.exr"), std::string::npos);
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
  EXPECT_GT(refused, 50);
}

}  // namespace
}  // namespace lapseam::test
