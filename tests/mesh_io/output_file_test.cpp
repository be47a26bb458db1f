#include "io/output_file.h"

#include <unistd.h>

#include "sample_meshes.h"

namespace lapseam {
namespace {

class OutputFileTest : public test::MeshFileTest {
 protected:
  void expect_io_error(const std::filesystem::path& file) {
    try {
      write_mesh(mesh_, file);
      ADD_FAILURE() << file << " was written";
    } catch (const IoError& error) {
      EXPECT_NE(std::string(error.what()).find(file.string()), std::string::npos) << error.what();
    }
  }
  Mesh mesh_ = test::grid_mesh(200, 200);  // over a megabyte: more than one buffer
};

TEST_F(OutputFileTest, ReplacesOnlyAtTheEnd) {
  write("a.txt", "old");
  {
    OutputFile out(path("a.txt"));
    out.write("new");
    out.close();
    EXPECT_EQ(read("a.txt"), "old");
    EXPECT_EQ(file_count(), 2u);
  }
  EXPECT_EQ(read("a.txt"), "old") << "not committed";
  EXPECT_EQ(file_count(), 1u) << "the temporary file must go";
  OutputFile out(path("a.txt"));
  out.write("new");
  out.commit();
  EXPECT_EQ(read("a.txt"), "new");
  EXPECT_EQ(file_count(), 1u);
}

TEST_F(OutputFileTest, WhatAKilledProcessLeftBehindGoes) {
  write(".a.txt.part0", "half");
  write(".a.txt.part3", "half");
  write(".a.txt.partner", "somebody's");
  {
    OutputFile first(path("a.txt")), second(path("a.txt"));  // of which neither is taken for left behind
    EXPECT_EQ(file_count(), 3u);
    first.write("first");
    second.write("second");
    second.commit();
    EXPECT_EQ(read("a.txt"), "second");
    OutputFile third(path("a.txt"));
    first.commit();
    EXPECT_EQ(read("a.txt"), "first");
  }
  EXPECT_EQ(file_count(), 2u);
  EXPECT_EQ(read(".a.txt.partner"), "somebody's");
}

TEST_F(OutputFileTest, TextIsWrittenWhole) {
  write("a.json", "old");
  write_text(path("a.json"), "{}\n");
  EXPECT_EQ(read("a.json"), "{}\n");
  EXPECT_EQ(file_count(), 1u);
  EXPECT_THROW(write_text(path("none/a.json"), "{}"), IoError);
}

TEST_F(OutputFileTest, FarMeshesKeepTheirPlaceInEveryFormat) {
  mesh_ = test::grid_mesh(4, 3);
  mesh_.origin_m = {4567890.125, 5432109.5, 300.25};
  for (const char* name : {"a.ply", "a.obj", "a.glb"}) {
    write_mesh(mesh_, path(name));
    const Mesh back = read_mesh(path(name));
    ASSERT_EQ(back.positions_m.size(), mesh_.positions_m.size()) << name;
    // Vertices may come in another order; their mean does not.
    Eigen::Vector3d expected = Eigen::Vector3d::Zero(), found = expected;
    for (std::size_t i = 0; i < mesh_.positions_m.size(); ++i) {
      expected += mesh_.origin_m + mesh_.positions_m[i].cast<double>();
      found += back.origin_m + back.positions_m[i].cast<double>();
    }
    EXPECT_LT((found - expected).norm() / double(mesh_.positions_m.size()), 1e-4) << name;
  }
}

TEST_F(OutputFileTest, LargeAndSmallPiecesInOrder) {
  const std::string large(3 << 20, 'x');
  OutputFile out(path("a"));
  out.write("begin");
  out.write(large);
  out.put(std::uint16_t(0x4241));
  out.write(std::string_view());
  out.commit();
  EXPECT_TRUE(read("a") == "begin" + large + "AB");
}

TEST_F(OutputFileTest, TwoWritersOfOneNameDoNotMix) {
  OutputFile first(path("a")), second(path("a"));
  first.write("first");
  second.write("second");
  second.commit();
  first.commit();
  EXPECT_EQ(read("a"), "first");
  EXPECT_EQ(file_count(), 1u);
}

TEST_F(OutputFileTest, MissingFolderAndFolderAsFile) {
  for (const char* name : {"a.ply", "a.obj", "a.glb"}) expect_io_error(path("nowhere") / name);
  std::filesystem::create_directory(path("folder.ply"));
  expect_io_error(path("folder.ply"));
}

TEST_F(OutputFileTest, FolderWithoutPermission) {
  if (geteuid() == 0) GTEST_SKIP() << "nothing is forbidden to root";
  std::filesystem::create_directory(path("locked"));
  std::filesystem::permissions(path("locked"), std::filesystem::perms::owner_read);
  expect_io_error(path("locked") / "a.ply");
  std::filesystem::permissions(path("locked"), std::filesystem::perms::owner_all);
}

TEST_F(OutputFileTest, FullDisk) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "this system has no /dev/full";
  for (const char* name : {"a.ply", "a.obj", "a.glb"}) {
    std::filesystem::create_symlink("/dev/full", path(name));
    expect_io_error(path(name));
    EXPECT_TRUE(std::filesystem::is_symlink(path(name))) << "a device is written to, not replaced";
  }
}

TEST_F(OutputFileTest, FailingMaterialLeavesNothingBehind) {
  Mesh mesh = test::grid_mesh(10, 10);
  test::add_texture(mesh);
  std::filesystem::create_directory(path("a_page_001.png"));
  EXPECT_THROW(write_mesh(mesh, path("a.obj")), IoError);
  EXPECT_EQ(file_count(), 1u);
}

TEST_F(OutputFileTest, LinksAreFollowed) {
  write("target.ply", "old");
  std::filesystem::create_symlink("target.ply", path("link.ply"));
  write_mesh(mesh_, path("link.ply"));
  EXPECT_TRUE(std::filesystem::is_symlink(path("link.ply")));
  EXPECT_EQ(read_mesh(path("target.ply")).vertex_count(), mesh_.vertex_count());
}

}  // namespace
}  // namespace lapseam
