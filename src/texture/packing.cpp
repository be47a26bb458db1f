#include "texture/packing.h"

#include <algorithm>
#include <functional>
#include <numeric>
#include <random>

#include "lapseam/context.h"

namespace lapseam {
namespace {

using Word = std::uint64_t;
constexpr int kBits = 64;

// Places that are compared, and rows below the first one that they are sought in.
constexpr int kMostPlaces = 64, kMoreRows = 3;

// What tightening takes out at once: shapes with their middle in a square of up to so many blocks to each side, unless
// these are too many.
constexpr int kSmallestWindow = 3, kLargestWindow = 18, kMostTakenOut = 40;
// Words of a page's rows that it may read for each block of the shapes.
constexpr std::uint64_t kWorkPerBlock = 4'000;

/// A row of bits, with shifts.
class BitRow {
 public:
  explicit BitRow(int bits) : words_(std::size_t(bits + kBits - 1) / kBits + 1, 0) {}

  void set(int from, int to, bool value) {
    for (int x = from; x < to; ++x) {
      Word& word = words_[std::size_t(x / kBits)];
      const Word bit = Word(1) << (x % kBits);
      word = value ? word | bit : word & ~bit;
    }
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
  std::size_t words() const { return words_.size(); }

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
  // Long ones rule out the most places.
  std::stable_sort(runs.begin(), runs.end(), [](const Run& a, const Run& b) { return a.to - a.from > b.to - b.from; });
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
  bool is_repeated;  // one before is the same
};

std::vector<Variant> variants_of(const BlockShape& shape) {
  std::vector<Variant> variants;
  const bool is_full = std::find(shape.used.begin(), shape.used.end(), 0) == shape.used.end();
  for (int turns = 0; turns < kMostTurns; ++turns) {
    BlockShape other = turned(shape, turns);
    const bool is_repeated = std::any_of(variants.begin(), variants.end(), [&](const Variant& before) {
      return before.shape.width == other.width && before.shape.used == other.used;
    });
    variants.push_back({std::move(other), {}, {}, is_full, is_repeated});
    if (is_repeated) continue;
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
    for (int turns = 0; turns < int(variants.size()); ++turns)
      if (!variants[std::size_t(turns)].is_repeated) find_place(variants, turns, most_touching, place);
    if (most_touching < 0) return false;
    const Variant& variant = variants[std::size_t(place.turns)];
    mark(variant, place, true);
    used_width_ = std::max(used_width_, place.x + variant.shape.width);
    used_height_ = std::max(used_height_, place.y + variant.shape.height);
    return true;
  }

  /// Of places that begin in rows from to to, or end there, that where most of its outline touches others.
  bool find_between(const std::vector<Variant>& variants, int from, int to, BlockPlace& place) {
    int most_touching = -1;
    for (int turns = 0; turns < int(variants.size()); ++turns) {
      const Variant& variant = variants[std::size_t(turns)];
      if (variant.is_repeated) continue;
      const int first = std::max(0, from - variant.shape.height + 1);
      compare_places(variant, turns, first, std::min(to, height_ - variant.shape.height), height_, most_touching,
                     place);
    }
    return most_touching >= 0;
  }

  void mark(const Variant& variant, const BlockPlace& place, bool is_used) {
    for (const Run& run : variant.runs)
      rows_[std::size_t(place.y + run.row)].set(place.x + run.from, place.x + run.to, is_used);
  }

  bool is_used(int x, int y) const { return rows_[std::size_t(y)].is_set(x); }
  /// Words of rows that were read.
  std::uint64_t work() const { return work_; }

  BlockPage used() const { return {used_width_, used_height_}; }

 private:
  // A full rectangle that is no smaller than one before cannot lie above where the search for that one began in vain.
  struct Start {
    int width, height, row;
  };

  void find_place(const std::vector<Variant>& variants, int turns, int& most_touching, BlockPlace& place) {
    const Variant& variant = variants[std::size_t(turns)];
    const int first = compare_places(variant, turns, first_row_for(variant), height_ - variant.shape.height, kMoreRows,
                                     most_touching, place);
    if (variant.is_full_rectangle) remember(variant.shape, first);
  }

  /// The first row that has a place; height_ where none has.
  int compare_places(const Variant& variant, int turns, int from, int to, int more_rows, int& most_touching,
                     BlockPlace& place) {
    const int limit = width_ - variant.shape.width + 1;
    int compared = 0, first_row = height_;
    for (int row = from; row <= to && row <= first_row + more_rows && compared < kMostPlaces; ++row) {
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
    return first_row;
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
        work_ += spread_.words();
      }
      blocked_.or_shifted(spread_, run.from);
      work_ += spread_.words();
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
  std::uint64_t work_ = 0;
};

/// One page of shapes, and the lowest height that they were found to fit in.
class Tightening {
 public:
  Tightening(const std::vector<BlockShape>& shapes, const std::vector<BlockPlace>& places, int page, BlockPage size)
      : width_(size.width), height_(size.height), page_(1, 1) {
    for (std::uint32_t i = 0; i < shapes.size(); ++i) {
      if (places[i].page != page) continue;
      numbers_.push_back(i);
      variants_.push_back(variants_of(shapes[i]));
      areas_.push_back(std::uint64_t(std::count(shapes[i].used.begin(), shapes[i].used.end(), 1)));
      best_.push_back(places[i]);
      most_work_ += kWorkPerBlock * areas_.back();
    }
  }

  void run(Context& context) {
    while (work_ < most_work_ && height_ > 1) {
      begin(height_ - 1);
      while (!out_.empty() && work_ < most_work_) {
        context.throw_if_cancelled();
        exchange();
      }
      if (!out_.empty()) return;
      best_ = places_;
      height_ = 0;
      for (std::uint32_t k = 0; k < best_.size(); ++k) height_ = std::max(height_, bottom_of(k, best_[k]));
    }
  }

  void get(std::vector<BlockPlace>& places, BlockPage& size) const {
    size = {0, 0};
    for (std::uint32_t k = 0; k < best_.size(); ++k) {
      const Variant& variant = variants_[k][std::size_t(best_[k].turns)];
      size.width = std::max(size.width, best_[k].x + variant.shape.width);
      size.height = std::max(size.height, best_[k].y + variant.shape.height);
      places[numbers_[k]] = best_[k];
    }
  }

 private:
  int bottom_of(std::uint32_t k, const BlockPlace& place) const {
    return place.y + variants_[k][std::size_t(place.turns)].shape.height;
  }

  /// The best places on a lower page; what does not fit is out.
  void begin(int height) {
    work_before_ = work_;
    page_ = Page(width_, height);
    places_ = best_;
    is_out_.assign(best_.size(), 0);
    out_.clear();
    for (std::uint32_t k = 0; k < best_.size(); ++k) {
      if (bottom_of(k, places_[k]) <= height)
        mark(k, true);
      else
        is_out_[k] = 1, out_.push_back(k);
    }
  }

  void mark(std::uint32_t k, bool is_used) {
    page_.mark(variants_[k][std::size_t(places_[k].turns)], places_[k], is_used);
  }

  std::uint64_t area_of(const std::vector<std::uint32_t>& some) const {
    std::uint64_t sum = 0;
    for (const std::uint32_t k : some) sum += areas_[k];
    return sum;
  }

  int random(int count) { return int(random_() % std::uint32_t(count)); }

  /// Takes shapes out around a gap, and puts these and all that are out in again, in an order that is by size and by
  /// chance. Undone where more is out afterwards than before.
  void exchange() {
    int from = 0, to = 0;
    const std::vector<std::uint32_t> taken = shapes_around_gap(from, to);
    std::vector<BlockPlace> places;
    for (const std::uint32_t k : taken) places.push_back(places_[k]);
    std::vector<std::pair<std::uint64_t, std::uint32_t>> order;
    const auto add = [&](std::uint32_t k) { order.emplace_back(areas_[k] * std::uint64_t(600 + random(1000)), k); };
    for (const std::uint32_t k : taken) add(k);
    for (const std::uint32_t k : out_) add(k);
    std::sort(order.begin(), order.end(), std::greater<>());
    for (const std::uint32_t k : taken) mark(k, false);
    std::vector<std::uint32_t> out, in;
    for (const auto& [key, k] : order) {
      if (page_.find_between(variants_[k], from, to, places_[k]))
        mark(k, true), in.push_back(k);
      else
        out.push_back(k);
    }
    work_ = work_before_ + page_.work() + ++exchanges_;
    if (area_of(out) <= area_of(out_)) {
      out_ = std::move(out);
      return;
    }
    for (const std::uint32_t k : in) mark(k, false);
    for (std::size_t n = 0; n < taken.size(); ++n) places_[taken[n]] = places[n], mark(taken[n], true);
  }

  /// And the rows that they reach over.
  std::vector<std::uint32_t> shapes_around_gap(int& from, int& to) {
    constexpr int kTries = 200;
    const int height = height_ - 1;
    int x = 0, y = 0;
    for (int k = 0; k < kTries; ++k) {
      x = random(width_), y = random(height);
      if (!page_.is_used(x, y)) break;
    }
    const int half = kSmallestWindow + random(kLargestWindow - kSmallestWindow + 1);
    from = std::max(0, y - half), to = std::min(height - 1, y + half);
    is_out_.assign(is_out_.size(), 0);
    for (const std::uint32_t k : out_) is_out_[k] = 1;
    std::vector<std::uint32_t> taken;
    for (std::uint32_t k = 0; k < places_.size(); ++k) {
      const BlockShape& shape = variants_[k][std::size_t(places_[k].turns)].shape;
      if (is_out_[k] || std::abs(places_[k].x + shape.width / 2 - x) > half ||
          std::abs(places_[k].y + shape.height / 2 - y) > half)
        continue;
      taken.push_back(k);
      from = std::min(from, places_[k].y);
      to = std::max(to, places_[k].y + shape.height - 1);
      if (int(taken.size()) > kMostTakenOut) return {};
    }
    return taken;
  }

  int width_, height_;
  Page page_;
  std::vector<std::uint32_t> numbers_;  // among all shapes
  std::vector<std::vector<Variant>> variants_;
  std::vector<std::uint64_t> areas_;
  std::vector<BlockPlace> best_, places_;
  std::vector<std::uint32_t> out_;
  std::vector<std::uint8_t> is_out_;
  std::uint64_t work_ = 0, work_before_ = 0, most_work_ = 0, exchanges_ = 0;
  std::mt19937 random_;
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

void tighten(const std::vector<BlockShape>& shapes, Packing& packing, Context& context) {
  for (int page = 0; page < int(packing.pages.size()); ++page) {
    Tightening tightening(shapes, packing.places, page, packing.pages[std::size_t(page)]);
    tightening.run(context);
    tightening.get(packing.places, packing.pages[std::size_t(page)]);
  }
}

}  // namespace lapseam
