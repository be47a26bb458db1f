#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include "lapseam/error.h"
#include "lapseam/io.h"

namespace lapseam::test {

/// A folder of its own for each test, gone at the end.
class MeshFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::temp_directory_path() / (std::string("lapseam_") + info->test_suite_name() + "_" +
                                                        info->name() + "_" + std::to_string(std::random_device{}()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::filesystem::path path(const std::string& name) const { return folder_ / name; }

  std::filesystem::path write(const std::string& name, const std::string& content) const {
    std::ofstream(path(name), std::ios::binary) << content;
    return path(name);
  }
  std::string read(const std::string& name) const {
    std::ifstream in(path(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  std::size_t file_count() const {
    return std::size_t(std::distance(std::filesystem::directory_iterator(folder_), {}));
  }

  /// read_mesh must refuse the file in one line that names it; gives that line.
  std::string refusal(const std::filesystem::path& file) const {
    try {
      const Mesh mesh = read_mesh(file);
      ADD_FAILURE() << file << " was read: " << mesh.vertex_count() << " vertices";
    } catch (const InvalidInput& error) {
      const std::string text = error.what();
      EXPECT_NE(text.find(file.filename().string()), std::string::npos) << text;
      EXPECT_EQ(text.find('\n'), std::string::npos) << text;
      return text;
    }
    return {};
  }

 private:
  std::filesystem::path folder_;
};

/// A bumpy grid of columns × rows vertices; every number in it is different.
inline Mesh grid_mesh(std::uint32_t columns, std::uint32_t rows) {
  Mesh mesh;
  for (std::uint32_t v = 0; v < rows; ++v)
    for (std::uint32_t u = 0; u < columns; ++u)
      mesh.positions_m.emplace_back(0.1f * float(u), -0.07f * float(v), 0.013f * float((u * 7 + v * 3) % 11));
  for (std::uint32_t v = 0; v + 1 < rows; ++v)
    for (std::uint32_t u = 0; u + 1 < columns; ++u) {
      const std::uint32_t a = v * columns + u, b = a + 1, c = a + columns, d = c + 1;
      mesh.triangles.push_back({a, c, b});
      mesh.triangles.push_back({b, c, d});
    }
  return mesh;
}

inline void add_colors(Mesh& mesh) {
  for (std::size_t i = 0; i < mesh.vertex_count(); ++i)
    mesh.colors.push_back({std::uint8_t(i), std::uint8_t(255 - i), std::uint8_t(3 * i)});
}

inline void add_provenance(Mesh& mesh) {
  for (std::size_t i = 0; i < mesh.vertex_count(); ++i) {
    mesh.vertex_view.push_back(std::uint32_t(i % 5));
    mesh.vertex_pixel.push_back(4000000000u + std::uint32_t(i));
  }
  for (std::size_t i = 0; i < mesh.triangle_count(); ++i) {
    mesh.triangle_view.push_back(i % 4 == 3 ? kInvalidIndex : std::uint32_t(i % 4));
    mesh.triangle_tag.push_back(TriangleTag(i % 3));
  }
}

/// Two pages; the first half of the triangles on the first, the next quarter on the second, the rest without texture.
inline void add_texture(Mesh& mesh) {
  for (int page = 0; page < 2; ++page) {
    ColorImage image(64, 32);
    for (int v = 0; v < image.height; ++v)
      for (int u = 0; u < image.width; ++u)
        image.at(u, v) = {std::uint8_t(4 * u), std::uint8_t(8 * v), std::uint8_t(page * 255)};
    mesh.pages.push_back(image);
  }
  const std::size_t count = mesh.triangle_count();
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t page = i < count / 2 ? 0 : i < 3 * count / 4 ? 1 : kInvalidIndex;
    mesh.triangle_page.push_back(page);
    auto& uv = mesh.texcoords.emplace_back();
    // Neighbours agree on most coordinates, and every fifth triangle is a chart of its own.
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3f& p = mesh.positions_m[mesh.triangles[i][k]];
      uv[k] = Eigen::Vector2f(p.x() + 0.1f, -p.y() + (i % 5 == 0 ? 0.4f : 0.05f)).cwiseMin(1.0f).cwiseMax(0.0f);
    }
  }
}

/// All that can be compared triangle by triangle, however the triangles and vertices of `b` are ordered, as long as
/// `order` gives for each of b's triangles the one of a.
inline void expect_same_corners(const Mesh& a, const Mesh& b, const std::vector<std::size_t>& order,
                                double tolerance_m) {
  ASSERT_EQ(b.triangle_count(), order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t va = a.triangles[order[i]][k], vb = b.triangles[i][k];
      const Eigen::Vector3d pa = a.origin_m + a.positions_m[va].cast<double>();
      const Eigen::Vector3d pb = b.origin_m + b.positions_m[vb].cast<double>();
      ASSERT_LE((pa - pb).norm(), tolerance_m) << "triangle " << i;
      if (!a.texcoords.empty() && a.triangle_page[order[i]] != kInvalidIndex) {
        ASSERT_EQ(b.triangle_page[i], a.triangle_page[order[i]]);
        // OBJ counts v from below: one rounding each way.
        ASSERT_LE((a.texcoords[order[i]][k] - b.texcoords[i][k]).norm(), 1.2e-7f) << "triangle " << i;
      } else if (!b.triangle_page.empty()) {
        ASSERT_EQ(b.triangle_page[i], kInvalidIndex);
      }
    }
  }
}

/// JPEG at quality 90 on smooth ramps: a few grey levels.
inline void expect_similar_pages(const Mesh& a, const Mesh& b) {
  ASSERT_EQ(a.pages.size(), b.pages.size());
  for (std::size_t p = 0; p < a.pages.size(); ++p) {
    ASSERT_EQ(a.pages[p].width, b.pages[p].width);
    ASSERT_EQ(a.pages[p].height, b.pages[p].height);
    for (std::size_t i = 0; i < a.pages[p].size(); ++i) {
      const Rgb8 x = a.pages[p].pixels[i], y = b.pages[p].pixels[i];
      ASSERT_LE(std::abs(int(x.r) - int(y.r)) + std::abs(int(x.g) - int(y.g)) + std::abs(int(x.b) - int(y.b)), 30);
    }
  }
}

inline std::vector<std::size_t> identity_order(const Mesh& mesh) {
  std::vector<std::size_t> order(mesh.triangle_count());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  return order;
}

}  // namespace lapseam::test
