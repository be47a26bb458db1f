#pragma once

// Plain images. Pixel (u, v) is column u, row v; row-major; pixel centres are at integers.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

namespace lapseam {

/// "No sample here." Every valid range is finite and greater than zero, so `r > 0` is the test for validity.
inline constexpr float kInvalidRange = 0.0f;

/// Where pixels may live instead of the heap.
class PixelStore {
 public:
  virtual ~PixelStore() = default;
  /// Aligned to a page, zero. Throws IoError.
  virtual void* allocate(std::size_t bytes) = 0;
  virtual void deallocate(void* data, std::size_t bytes) noexcept = 0;
  /// Gives back what has been read, if the store's budget asks for it. Some microseconds; for between two views.
  virtual void relieve() = 0;
};

/// Heap, or a store. What is moved keeps its store; what is copied lives in the heap.
template <typename T>
class PixelAllocator {
 public:
  using value_type = T;
  using propagate_on_container_move_assignment = std::true_type;
  using propagate_on_container_swap = std::true_type;
  using is_always_equal = std::false_type;

  PixelAllocator() = default;
  explicit PixelAllocator(std::shared_ptr<PixelStore> store) : store_(std::move(store)) {}
  template <typename U>
  PixelAllocator(const PixelAllocator<U>& other) : store_(other.store()) {}

  T* allocate(std::size_t n) {
    return store_ ? static_cast<T*>(store_->allocate(n * sizeof(T))) : std::allocator<T>().allocate(n);
  }
  void deallocate(T* data, std::size_t n) noexcept {
    if (store_)
      store_->deallocate(data, n * sizeof(T));
    else
      std::allocator<T>().deallocate(data, n);
  }
  PixelAllocator select_on_container_copy_construction() const { return {}; }
  const std::shared_ptr<PixelStore>& store() const { return store_; }
  friend bool operator==(const PixelAllocator& a, const PixelAllocator& b) { return a.store_ == b.store_; }

 private:
  std::shared_ptr<PixelStore> store_;
};

template <typename T>
using Pixels = std::vector<T, PixelAllocator<T>>;

/// width × height values of T, row-major.
template <typename T>
struct Image {
  int width = 0;
  int height = 0;
  Pixels<T> pixels;

  Image() = default;
  Image(int w, int h, T fill = T{}) : width(w), height(h), pixels(std::size_t(w) * std::size_t(h), fill) {}

  std::size_t size() const { return pixels.size(); }
  bool empty() const { return pixels.empty(); }
  std::size_t index(int u, int v) const { return std::size_t(v) * std::size_t(width) + std::size_t(u); }
  T& at(int u, int v) { return pixels[index(u, v)]; }
  const T& at(int u, int v) const { return pixels[index(u, v)]; }
};

/// sRGB, 8 bits a channel.
struct Rgb8 {
  std::uint8_t r = 0, g = 0, b = 0;
  friend bool operator==(const Rgb8&, const Rgb8&) = default;
};

/// Metres; the meaning of range is the sensor's (see sensor.h); kInvalidRange where nothing was measured.
using RangeImage = Image<float>;
using ColorImage = Image<Rgb8>;

}  // namespace lapseam
