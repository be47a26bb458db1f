#include "core/spill_file.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <numeric>
#include <thread>

#include "core/memory.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

using std::filesystem::path;

// Less than any process takes: what is read is given back at every look.
MemoryBudget hardly_any() { return {1, {}}; }

Image<std::uint32_t> counted_image() {
  Image<std::uint32_t> image(1000, 700);
  std::iota(image.pixels.begin(), image.pixels.end(), 7u);
  return image;
}

Image<std::uint32_t> spilled_image(Context& context) {
  context.set_memory_budget(hardly_any());
  Image<std::uint32_t> image = counted_image();
  spill(image.pixels, context);
  return image;
}

TEST(SpillFile, WhatIsGivenBackIsReadAgain) {
  Context context(1);
  context.set_memory_budget(hardly_any());
  Image<std::uint32_t> image = counted_image();
  const std::uint32_t* const in_heap = image.pixels.data();
  spill(image.pixels, context);
  EXPECT_NE(image.pixels.data(), in_heap);
  EXPECT_EQ(context.memory_use().largest_stored_bytes / 4096, (1000u * 700 * 4 + 4095) / 4096);
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (context.memory_use().evictions == 0 && std::chrono::steady_clock::now() < deadline)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_GT(context.memory_use().evictions, 0u);
  EXPECT_EQ(image.pixels, counted_image().pixels);
}

TEST(SpillFile, RelievesAtOnceWhenAsked) {
  Context context(1);
  Image<std::uint32_t> image = spilled_image(context);
  image.pixels.get_allocator().store()->relieve();
  EXPECT_GT(context.memory_use().evictions, 0u);
  EXPECT_EQ(image.pixels, counted_image().pixels);
}

TEST(SpillFile, GivesBackAPartAtATime) {
  constexpr int kImages = 32;
  const std::uint64_t before = rss_bytes(), all = std::max<std::uint64_t>(96'000'000, 2 * before);
  Context context(1);
  context.set_memory_budget({before + 25'000'000 + all / 2, {}});
  std::vector<Image<std::uint32_t>> images;
  for (int i = 0; i < kImages; ++i)
    images.push_back(make_spilled_image<std::uint32_t>(1000, int(all / kImages / 4000), context));
  images.front().pixels.get_allocator().store()->relieve();
  EXPECT_GT(context.memory_use().evictions, 1u);
  EXPECT_GT(rss_bytes(), before + all / 8) << "some of the images are left";
  EXPECT_LT(rss_bytes(), before + all);
}

TEST(SpillFile, WithoutABudgetPixelsStayWhereTheyAre) {
  Context context(1);
  Image<std::uint32_t> image = counted_image();
  const std::uint32_t* const in_heap = image.pixels.data();
  spill(image.pixels, context);
  EXPECT_EQ(image.pixels.data(), in_heap);
  EXPECT_EQ(context.memory_use().budget_bytes, 0u);
}

TEST(SpillFile, MovesKeepTheFileAndCopiesLeaveIt) {
  Context context(1);
  Image<std::uint32_t> image = spilled_image(context);
  const Image<std::uint32_t> copy = image;
  EXPECT_EQ(copy.pixels.get_allocator().store(), nullptr);
  const std::uint32_t* const in_file = image.pixels.data();
  Image<std::uint32_t> moved;
  moved = std::move(image);
  EXPECT_EQ(moved.pixels.data(), in_file);
  EXPECT_EQ(moved.pixels, copy.pixels);
}

TEST(SpillFile, PixelsOutliveTheContext) {
  Image<std::uint32_t> image = counted_image();
  {
    Context context(1);
    context.set_memory_budget(hardly_any());
    spill(image.pixels, context);
  }
  EXPECT_EQ(image.pixels, counted_image().pixels);
}

TEST(SpillFile, ASealNoticesAChangedPixel) {
  Context context(1);
  Image<std::uint32_t> image = spilled_image(context);
  seal(image.pixels, context);
  const auto is_whole = [&] { return spill_file_of(context)->is_whole(image.pixels.data()); };
  EXPECT_TRUE(is_whole());
  image.at(500, 300) ^= 1u << 20;
  EXPECT_FALSE(is_whole());
  image.at(500, 300) ^= 1u << 20;
  EXPECT_TRUE(is_whole());
}

TEST(SpillFile, LeavesNothingInItsFolder) {
  const path folder = path(::testing::TempDir()) / "spill_file_test";
  std::filesystem::create_directories(folder);
  Context context(1);
  context.set_memory_budget({1, folder});
  Image<std::uint32_t> image = counted_image();
  spill(image.pixels, context);
  EXPECT_TRUE(std::filesystem::is_empty(folder));
  std::filesystem::remove(folder);
}

TEST(SpillFile, AFolderThatIsNotThereIsNamed) {
  Context context(1);
  try {
    context.set_memory_budget({1, "/no/such/folder"});
    FAIL();
  } catch (const IoError& error) {
    EXPECT_NE(std::string(error.what()).find("/no/such/folder"), std::string::npos) << error.what();
  }
}

TEST(SpillFile, MoreThanTheDiskHasIsAnError) {
  Context context(1);
  context.set_memory_budget(hardly_any());
  // More than any file may have: refused before anything is touched.
  EXPECT_THROW(spill_file_of(context)->allocate(std::size_t(1) << 62), IoError);
  Image<std::uint32_t> image = counted_image();
  spill(image.pixels, context);
  EXPECT_EQ(image.pixels, counted_image().pixels);
}

}  // namespace
}  // namespace lapseam
