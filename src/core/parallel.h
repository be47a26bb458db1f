#pragma once

// The only place that includes TBB. Every loop here gives the same result for any number of threads: blocks are fixed
// by the grain alone, reductions join in a fixed tree, sorts need a total order.

#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>
#include <tbb/parallel_sort.h>
#include <tbb/task_arena.h>

#include <cstddef>
#include <utility>
#include <vector>

#include "lapseam/context.h"

namespace lapseam {

tbb::task_arena& arena_of(Context& context);

/// Calls body(begin, end) for blocks of at most `grain` items of [0, n). Cancel is checked before each block.
template <typename Body>
void parallel_blocks(Context& context, std::size_t n, std::size_t grain, const Body& body) {
  if (n == 0) return;
  arena_of(context).execute([&] {
    const std::size_t blocks = (n + grain - 1) / grain;
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, blocks, 1), [&](const tbb::blocked_range<std::size_t>& range) {
      for (std::size_t b = range.begin(); b != range.end(); ++b) {
        context.throw_if_cancelled();
        const std::size_t begin = b * grain;
        body(begin, begin + grain < n ? begin + grain : n);
      }
    });
  });
}

/// Calls body(i) for every i in [0, n).
template <typename Body>
void parallel_for(Context& context, std::size_t n, std::size_t grain, const Body& body) {
  parallel_blocks(context, n, grain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i != end; ++i) body(i);
  });
}

/// What collect(i, found) appends to `found` for every i in [0, n), in the order of i.
template <typename T, typename Collect>
std::vector<T> parallel_collect(Context& context, std::size_t n, std::size_t grain, const Collect& collect) {
  std::vector<std::vector<T>> of_block((n + grain - 1) / grain);
  parallel_blocks(context, n, grain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) collect(i, of_block[begin / grain]);
  });
  std::vector<T> all;
  for (const std::vector<T>& found : of_block) all.insert(all.end(), found.begin(), found.end());
  return all;
}

/// Deterministic reduction: fold(begin, end, Value) -> Value over fixed blocks, join(Value, Value) -> Value in a fixed
/// tree.
template <typename Value, typename Fold, typename Join>
Value parallel_reduce(Context& context, std::size_t n, std::size_t grain, const Value& identity, const Fold& fold,
                      const Join& join) {
  Value result = identity;
  if (n == 0) return result;
  arena_of(context).execute([&] {
    result = tbb::parallel_deterministic_reduce(
        tbb::blocked_range<std::size_t>(0, n, grain), identity,
        [&](const tbb::blocked_range<std::size_t>& range, Value value) {
          context.throw_if_cancelled();
          return fold(range.begin(), range.end(), std::move(value));
        },
        join, tbb::simple_partitioner());
  });
  return result;
}

/// Not stable: `less` must be a total order (end it with the index).
template <typename Iterator, typename Less>
void parallel_sort(Context& context, Iterator begin, Iterator end, const Less& less) {
  arena_of(context).execute([&] { tbb::parallel_sort(begin, end, less); });
}

/// Runs f inside the context's arena, for libraries that bring their own TBB loops (Embree's builder).
template <typename F>
void run_in_arena(Context& context, const F& f) {
  arena_of(context).execute(f);
}

}  // namespace lapseam
