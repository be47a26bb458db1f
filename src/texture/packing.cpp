#include "texture/packing.h"

#include <algorithm>
#include <numeric>

#include "lapseam/context.h"

namespace lapseam {
namespace {

using Word = std::uint64_t;
constexpr int kBits = 64;

// Places that are compared, and rows below the first one that they are sought in.
constexpr int kMostPlaces = 64, kMoreRows = 3;

/// A row of bits, with shifts.
class BitRow {
 public:
  explicit BitRow(int bits) : words_(std::size_t(bits + kBits - 1) / kBits + 1, 0) {}

  void set(int from, int to) {
    for (int x = from; x < to; ++x) words_[std::size_t(x / kBits)] |= Word(1) << (x % kBits);
  }
  /// this |= other >> shift
  void or_shifted(const BitRow& other, int shift) {
    const std::size_t skip = std::size_t(shift / kBits);
    const int rest = shift % kBits;
    for (std::size_t i = 0; i + skip < words_.size(); ++i) {
      Word word = other.words_[i + skip] >> rest;
      if (rest > 0 && i + skip + 1 < words_.size()) word |= other.words_[i + skip + 1] << (kBits - rest);
      words_[i] |= word;
    }
  }
  /// Lowest bit under `limit` that is not set; limit when there is none.
  int first_clear(int limit) const {
    for (int x = 0; x < limit;) {
      const Word inverted = ~words_[std::size_t(x / kBits)] >> (x % kBits);
      if (inverted != 0) {
        const int found = x + __builtin_ctzll(inverted);
        return std::min(found, limit);
      }
      x = (x / kBits + 1) * kBits;
    }
    return limit;
  }
  bool is_set(int x) const { return (words_[std::size_t(x / kBits)] >> (x % kBits) & 1) != 0; }
  /// Lowest bit of `from` to `limit` that is not set; limit when there is none.
  int next_clear(int from, int limit) const {
    while (from < limit && is_set(from)) ++from;
    return from;
  }
  void clear() { std::fill(words_.begin(), words_.end(), Word(0)); }

 private:
  std::vector<Word> words_;
};

struct Run {
  int row, from, to;
};

std::vector<Run> runs_of(const BlockShape& shape) {
  std::vector<Run> runs;
  for (int y = 0; y < shape.height; ++y)
    for (int x = 0; x < shape.width; ++x) {
      if (!shape.used[std::size_t(y * shape.width + x)]) continue;
      const int from = x;
      while (x < shape.width && shape.used[std::size_t(y * shape.width + x)]) ++x;
      runs.push_back({y, from, x});
    }
  return runs;
}

/// Blocks outside a shape that one of it has at its side.
std::vector<std::pair<int, int>> outline_of(const BlockShape& shape) {
  const auto is_used = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < shape.width && y < shape.height && shape.used[std::size_t(y * shape.width + x)] != 0;
  };
  std::vector<std::pair<int, int>> outline;
  for (int y = -1; y <= shape.height; ++y)
    for (int x = -1; x <= shape.width; ++x)
      if (!is_used(x, y) && (is_used(x - 1, y) || is_used(x + 1, y) || is_used(x, y - 1) || is_used(x, y + 1)))
        outline.emplace_back(x, y);
  return outline;
}

BlockShape turned(const BlockShape& shape, int turns) {
  BlockShape out{turns % 2 ? shape.height : shape.width, turns % 2 ? shape.width : shape.height, {}};
  out.used.resize(shape.used.size());
  for (int y = 0; y < shape.height; ++y)
    for (int x = 0; x < shape.width; ++x) {
      const auto [u, v] = turn(x, y, shape.width, shape.height, turns);
      out.used[std::size_t(v * out.width + u)] = shape.used[std::size_t(y * shape.width + x)];
    }
  return out;
}

/// A shape in one of its turns.
struct Variant {
  BlockShape shape;
  std::vector<Run> runs;
  std::vector<std::pair<int, int>> outline;
  bool is_full_rectangle;
};

std::vector<Variant> variants_of(const BlockShape& shape) {
  std::vector<Variant> variants;
  for (int turns = 0; turns < 4; ++turns) {
    BlockShape other = turned(shape, turns);
    const bool is_full = std::find(shape.used.begin(), shape.used.end(), 0) == shape.used.end();
    variants.push_back({std::move(other), {}, {}, is_full});
    variants.back().runs = runs_of(variants.back().shape);
    variants.back().outline = outline_of(variants.back().shape);
  }
  return variants;
}

class Page {
 public:
  Page(int width, int height)
      : width_(width),
        height_(height),
        rows_(std::size_t(height), BitRow(width)),
        blocked_(width),
        spread_(width),
        wider_(width) {}

  bool place(const std::vector<Variant>& variants, BlockPlace& place) {
    int most_touching = -1;
    for (int turns = 0; turns < int(variants.size()); ++turns) find_place(variants, turns, most_touching, place);
    if (most_touching < 0) return false;
    const Variant& variant = variants[std::size_t(place.turns)];
    for (const Run& run : variant.runs) rows_[std::size_t(place.y + run.row)].set(place.x + run.from, place.x + run.to);
    used_width_ = std::max(used_width_, place.x + variant.shape.width);
    used_height_ = std::max(used_height_, place.y + variant.shape.height);
    return true;
  }

  BlockPage used() const { return {used_width_, used_height_}; }

 private:
  // A full rectangle that is no smaller than one before cannot lie above where the search for that one began in vain.
  struct Start {
    int width, height, row;
  };

  void find_place(const std::vector<Variant>& variants, int turns, int& most_touching, BlockPlace& place) {
    const Variant& variant = variants[std::size_t(turns)];
    const BlockShape& shape = variant.shape;
    const int limit = width_ - shape.width + 1;
    int compared = 0, first_row = height_;
    for (int row = first_row_for(variant); row + shape.height <= height_ && row <= first_row + kMoreRows; ++row) {
      find_blocked(variant.runs, row, limit);
      for (int at = blocked_.first_clear(limit); at < limit && compared < kMostPlaces;
           at = blocked_.next_clear(at + 1, limit), ++compared) {
        first_row = std::min(first_row, row);
        const int touching = count_touching(variant.outline, at, row);
        if (touching > most_touching) {
          most_touching = touching;
          place.x = at, place.y = row, place.turns = turns;
        }
      }
    }
    if (variant.is_full_rectangle) remember(shape, first_row);
  }

  int first_row_for(const Variant& variant) const {
    int row = 0;
    if (variant.is_full_rectangle)
      for (const Start& start : starts_)
        if (start.width <= variant.shape.width && start.height <= variant.shape.height) row = std::max(row, start.row);
    return row;
  }

  void remember(const BlockShape& shape, int row) {
    const auto same = std::find_if(starts_.begin(), starts_.end(), [&](const Start& start) {
      return start.width == shape.width && start.height == shape.height;
    });
    if (same == starts_.end())
      starts_.push_back({shape.width, shape.height, row});
    else
      same->row = row;
  }

  /// All places in a row where some block of the shape would meet a used one: each row of the page, spread by the run's
  /// length.
  void find_blocked(const std::vector<Run>& runs, int y, int limit) {
    blocked_.clear();
    for (const Run& run : runs) {
      spread_ = rows_[std::size_t(y + run.row)];
      int covered = 1;
      for (const int length = run.to - run.from; covered < length;) {
        const int step = std::min(covered, length - covered);
        wider_ = spread_;
        spread_.or_shifted(wider_, step);
        covered += step;
      }
      blocked_.or_shifted(spread_, run.from);
      if (blocked_.first_clear(limit) == limit) break;
    }
  }

  int count_touching(const std::vector<std::pair<int, int>>& outline, int x, int y) const {
    return int(std::count_if(outline.begin(), outline.end(), [&](const std::pair<int, int>& block) {
      const int u = x + block.first, v = y + block.second;
      return u < 0 || v < 0 || u >= width_ || v >= height_ || rows_[std::size_t(v)].is_set(u);
    }));
  }

  int width_, height_;
  std::vector<BitRow> rows_;
  BitRow blocked_, spread_, wider_;
  std::vector<Start> starts_;
  int used_width_ = 0, used_height_ = 0;
};

}  // namespace

Packing pack_blocks(const std::vector<BlockShape>& shapes, int page_width, int page_height, Context& context) {
  Packing out;
  out.places.resize(shapes.size());
  std::vector<std::uint32_t> order(shapes.size());
  std::vector<std::uint64_t> area(shapes.size());
  std::iota(order.begin(), order.end(), 0u);
  for (std::size_t i = 0; i < shapes.size(); ++i)
    area[i] = std::uint64_t(shapes[i].width) * std::uint64_t(shapes[i].height);
  std::sort(order.begin(), order.end(),
            [&](std::uint32_t a, std::uint32_t b) { return area[a] != area[b] ? area[a] > area[b] : a < b; });
  std::vector<Page> pages;
  for (const std::uint32_t i : order) {
    context.throw_if_cancelled();
    const std::vector<Variant> variants = variants_of(shapes[i]);
    BlockPlace& place = out.places[i];
    for (place.page = 0;; ++place.page) {
      if (std::size_t(place.page) == pages.size()) pages.emplace_back(page_width, page_height);
      if (pages[std::size_t(place.page)].place(variants, place)) break;
    }
  }
  for (const Page& page : pages) out.pages.push_back(page.used());
  return out;
}

}  // namespace lapseam
