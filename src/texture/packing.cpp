#include "texture/packing.h"

#include <algorithm>
#include <numeric>

#include "lapseam/context.h"

namespace lapseam {
namespace {

using Word = std::uint64_t;
constexpr int kBits = 64;

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

class Page {
 public:
  Page(int width, int height) : width_(width), height_(height), rows_(std::size_t(height), BitRow(width)) {}

  bool place(const BlockShape& shape, const std::vector<Run>& runs, int from_row, int& x, int& y) {
    BitRow blocked(width_), spread(width_), wider(width_);
    for (y = from_row; y + shape.height <= height_; ++y) {
      blocked.clear();
      const int limit = width_ - shape.width + 1;
      for (const Run& run : runs) {
        // All places where some block of the run would meet a used one: the row, spread by the run's length.
        const BitRow& row = rows_[std::size_t(y + run.row)];
        spread = row;
        int covered = 1;
        for (const int length = run.to - run.from; covered < length;) {
          const int step = std::min(covered, length - covered);
          wider = spread;
          spread.or_shifted(wider, step);
          covered += step;
        }
        blocked.or_shifted(spread, run.from);
        if (blocked.first_clear(limit) == limit) break;
      }
      x = blocked.first_clear(limit);
      if (x == limit) continue;
      for (const Run& run : runs) rows_[std::size_t(y + run.row)].set(x + run.from, x + run.to);
      used_width_ = std::max(used_width_, x + shape.width);
      used_height_ = std::max(used_height_, y + shape.height);
      return true;
    }
    return false;
  }

  BlockPage used() const { return {used_width_, used_height_}; }

 private:
  int width_, height_;
  std::vector<BitRow> rows_;
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
  // A shape that is no smaller than one before cannot lie above where the search for that one began in vain.
  struct Start {
    int width = 0, height = 0, row = 0;
  };
  std::vector<std::vector<Start>> starts;
  for (const std::uint32_t i : order) {
    context.throw_if_cancelled();
    const std::vector<Run> runs = runs_of(shapes[i]);
    BlockPlace& place = out.places[i];
    for (place.page = 0;; ++place.page) {
      if (std::size_t(place.page) == pages.size()) {
        pages.emplace_back(page_width, page_height);
        starts.emplace_back();
      }
      const bool is_full_rectangle =
          runs.size() == std::size_t(shapes[i].height) &&
          std::all_of(runs.begin(), runs.end(), [&](const Run& r) { return r.to - r.from == shapes[i].width; });
      int from_row = 0;
      // Only full rectangles tell about others: where one did not fit, no shape that has it inside does.
      auto& known = starts[std::size_t(place.page)];
      if (is_full_rectangle)
        for (const Start& start : known)
          if (start.width <= shapes[i].width && start.height <= shapes[i].height)
            from_row = std::max(from_row, start.row);
      const bool is_placed = pages[std::size_t(place.page)].place(shapes[i], runs, from_row, place.x, place.y);
      if (is_full_rectangle) {
        const auto same = std::find_if(known.begin(), known.end(), [&](const Start& start) {
          return start.width == shapes[i].width && start.height == shapes[i].height;
        });
        const int row = is_placed ? place.y : page_height;
        if (same == known.end())
          known.push_back({shapes[i].width, shapes[i].height, row});
        else
          same->row = row;
      }
      if (is_placed) break;
    }
  }
  for (const Page& page : pages) out.pages.push_back(page.used());
  return out;
}

}  // namespace lapseam
