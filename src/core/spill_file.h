#pragma once

// Images that need not be in memory: they lie in a temporary file that is mapped. Any thread may read and write them as
// if they were in the heap; the kernel fetches what it does not hold, page by page. A thread of the file's own watches
// the process and gives pages back when it takes more than it may.

#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <thread>

#include "lapseam/context.h"
#include "lapseam/image.h"

namespace lapseam {

class SpillFile : public PixelStore {
 public:
  /// Throws IoError.
  explicit SpillFile(const MemoryBudget& budget);
  ~SpillFile() override;
  SpillFile(const SpillFile&) = delete;
  SpillFile& operator=(const SpillFile&) = delete;

  /// Room on the disk is reserved at once: throws IoError when there is none.
  void* allocate(std::size_t bytes) override;
  void deallocate(void* data, std::size_t bytes) noexcept override;
  void relieve() override;

  /// Remembers a checksum of what was allocated at `data`: it does not change from now on.
  void seal(const void* data);
  /// False: the disk did not give back what was sealed there.
  bool is_whole(const void* data) const;

  MemoryUse use() const;
  const std::filesystem::path& folder() const { return folder_; }

 private:
  struct Block {
    std::size_t size = 0;
    std::uint64_t place = 0;  // in the file
    std::uint32_t checksum = 0;
    bool is_sealed = false;
  };
  void* map(std::size_t size);
  Block block_at(const void* data) const;
  void watch();
  // Both under the mutex; what the process takes afterwards.
  std::uint64_t give_back_if_needed();
  std::uint64_t give_back_images(std::uint64_t now, std::uint64_t target);

  MemoryBudget budget_;
  std::filesystem::path folder_;
  int descriptor_ = -1;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool stops_ = false;
  std::map<const void*, Block> blocks_;
  const void* last_given_back_ = nullptr;
  std::uint64_t end_ = 0, stored_ = 0;
  std::uint64_t threshold_ = 0, next_ = 0;  // resident bytes at which something is given back
  MemoryUse use_;
  std::thread watcher_;
};

/// The context's file; null where memory has no budget.
std::shared_ptr<SpillFile> spill_file_of(const Context& context);

/// Moves pixels to the context's file, if it has one. For what is made whole and then read here and there.
template <typename T>
void spill(Pixels<T>& pixels, const Context& context) {
  const std::shared_ptr<SpillFile> file = spill_file_of(context);
  if (!file || pixels.empty() || pixels.get_allocator().store()) return;
  pixels = Pixels<T>(pixels.begin(), pixels.end(), PixelAllocator<T>(file));
}

/// Spilled pixels that are final; nothing for others. See SpillFile, which also says whether they are whole.
template <typename T>
void seal(const Pixels<T>& pixels, const Context& context) {
  if (pixels.get_allocator().store()) spill_file_of(context)->seal(pixels.data());
}

/// An image in the context's file from the start, all zero.
template <typename T>
Image<T> make_spilled_image(int width, int height, const Context& context) {
  Image<T> image;
  image.width = width;
  image.height = height;
  image.pixels = Pixels<T>(std::size_t(width) * std::size_t(height), T{}, PixelAllocator<T>(spill_file_of(context)));
  return image;
}

}  // namespace lapseam
