#include "core/spill_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <system_error>

#include "core/crc32c.h"
#include "core/memory.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

// Between two looks the process may take as much as this more: the watcher shares the processors with all workers.
constexpr std::uint64_t kMargin = 25'000'000;
// So much it may take in a millisecond, which is also the shortest time between two looks. Far below the budget there
// is no need to look that often.
constexpr std::uint64_t kBytesPerMillisecond = kMargin;
constexpr std::uint64_t kLongestWait_ms = 20;
// Giving back what is read again at once helps nobody: the next time is when so much has come in again.
constexpr std::uint64_t kLeastEviction = 4'000'000;
// Of the threshold, what is given back at a time: images that are looked at stay, until it is their turn.
constexpr std::uint64_t kEvictedPart = 8;
constexpr double kMuchKept = 0.25;  // by the allocator, of what the process has

std::size_t whole_pages(std::size_t bytes) {
  static const auto page = std::size_t(::sysconf(_SC_PAGESIZE));
  return (bytes + page - 1) / page * page;
}

std::string describe(int error) { return std::generic_category().message(error); }

// A file without a name: nothing is left behind, however the process ends.
int open_nameless(const std::filesystem::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor >= 0 || (errno != EOPNOTSUPP && errno != EISDIR && errno != EINVAL)) return descriptor;
  std::string name = (folder / "lapseam-XXXXXX").string();  // file systems that know no such files
  const int named = ::mkostemp(name.data(), O_CLOEXEC);
  if (named >= 0) ::unlink(name.c_str());
  return named;
}

}  // namespace

SpillFile::SpillFile(const MemoryBudget& budget)
    : budget_(budget), folder_(budget.folder.empty() ? std::filesystem::temp_directory_path() : budget.folder) {
  descriptor_ = open_nameless(folder_);
  if (descriptor_ < 0) throw IoError(folder_, "no temporary file can be made here: " + describe(errno));
  use_.budget_bytes = budget.bytes;
  next_ = threshold_ = budget.bytes > kMargin ? budget.bytes - kMargin : 0;
  watcher_ = std::thread([this] { watch(); });
}

SpillFile::~SpillFile() {
  {
    const std::scoped_lock lock(mutex_);
    stops_ = true;
  }
  wake_.notify_all();
  watcher_.join();
  ::close(descriptor_);
}

void* SpillFile::allocate(std::size_t bytes) {
  const std::size_t size = whole_pages(std::max<std::size_t>(bytes, 1));
  void* const data = map(size);
  // It is written at once, from end to end: a page at a time costs many times as much. Older systems cannot.
  [[maybe_unused]] const int ignored = ::madvise(data, size, MADV_POPULATE_WRITE);
  return data;
}

void* SpillFile::map(std::size_t size) {
  const std::scoped_lock lock(mutex_);
  // Without room reserved, a full disk would show as a signal at the first write to a page.
  if (const int error = ::posix_fallocate(descriptor_, off_t(end_), off_t(size)); error != 0)
    throw IoError(folder_, "no room for " + std::to_string(size) + " bytes of a temporary file: " + describe(error));
  void* const data = ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor_, off_t(end_));
  if (data == MAP_FAILED) throw IoError(folder_, "a temporary file cannot be mapped: " + describe(errno));
  blocks_.emplace(data, Block{size, end_, 0, false});
  end_ += size;
  stored_ += size;
  use_.largest_stored_bytes = std::max(use_.largest_stored_bytes, stored_);
  return data;
}

void SpillFile::deallocate(void* data, std::size_t) noexcept {
  const std::scoped_lock lock(mutex_);
  const auto found = blocks_.find(data);
  if (found == blocks_.end()) return;
  const Block block = found->second;
  ::munmap(data, block.size);
  stored_ -= block.size;
  blocks_.erase(found);
  // Places are not used again, but their room on the disk is, where the file system can.
  [[maybe_unused]] const int ignored =
      ::fallocate(descriptor_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, off_t(block.place), off_t(block.size));
}

SpillFile::Block SpillFile::block_at(const void* data) const {
  const std::scoped_lock lock(mutex_);
  const auto found = blocks_.find(data);
  return found == blocks_.end() ? Block{} : found->second;
}

void SpillFile::seal(const void* data) {
  const std::uint32_t checksum = crc32c(static_cast<const char*>(data), block_at(data).size);
  const std::scoped_lock lock(mutex_);
  const auto found = blocks_.find(data);
  if (found == blocks_.end()) return;
  found->second.checksum = checksum;
  found->second.is_sealed = true;
}

bool SpillFile::is_whole(const void* data) const {
  const Block block = block_at(data);
  return !block.is_sealed || crc32c(static_cast<const char*>(data), block.size) == block.checksum;
}

MemoryUse SpillFile::use() const {
  const std::scoped_lock lock(mutex_);
  return use_;
}

void SpillFile::watch() {
  std::unique_lock lock(mutex_);
  std::uint64_t wait_ms = 1;
  while (!wake_.wait_for(lock, std::chrono::milliseconds(wait_ms), [&] { return stops_; })) {
    const std::uint64_t now = give_back_if_needed(), left = next_ > now ? next_ - now : 0;
    wait_ms = std::clamp<std::uint64_t>(left / kBytesPerMillisecond, 1, kLongestWait_ms);
  }
}

void SpillFile::relieve() {
  const std::scoped_lock lock(mutex_);
  give_back_if_needed();
}

std::uint64_t SpillFile::give_back_if_needed() {
  std::uint64_t now = rss_bytes();
  if (now <= next_) return now;
  const std::uint64_t part = std::max(kLeastEviction, threshold_ / kEvictedPart);
  now = give_back_images(now, threshold_ > part ? threshold_ - part : 0);
  ++use_.evictions;
  // The kernel maps images again many pages at a time, the heap one by one: that is given back only where it is much.
  const std::uint64_t kept = free_memory_bytes().value_or(now);
  if (now + kLeastEviction > threshold_ || double(kept) > kMuchKept * double(now)) {
    release_free_memory();
    now = rss_bytes();
  }
  next_ = std::max(threshold_, now + kLeastEviction);
  return now;
}

// Those first whose turn was longest ago; the file keeps what is dropped.
std::uint64_t SpillFile::give_back_images(std::uint64_t now, std::uint64_t target) {
  auto at = blocks_.upper_bound(last_given_back_);
  for (std::size_t i = 0; i < blocks_.size() && now > target; ++i, ++at) {
    if (at == blocks_.end()) at = blocks_.begin();
    last_given_back_ = at->first;
    ::madvise(const_cast<void*>(last_given_back_), at->second.size, MADV_DONTNEED);
    now = rss_bytes();
  }
  return now;
}

}  // namespace lapseam
