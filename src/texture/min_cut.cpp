#include "texture/min_cut.h"

#include <algorithm>
#include <boost/graph/boykov_kolmogorov_max_flow.hpp>
#include <boost/graph/compressed_sparse_row_graph.hpp>
#include <boost/range/iterator_range.hpp>
#include <cmath>
#include <numeric>

namespace lapseam {
namespace {

using Graph = boost::compressed_sparse_row_graph<boost::directedS, boost::no_property, boost::no_property,
                                                 boost::no_property, std::uint32_t, std::uint32_t>;
using Edge = boost::graph_traits<Graph>::edge_descriptor;

struct Arc {
  std::uint32_t from, to;
  std::int64_t capacity;
  std::uint32_t pair;  // place of the arc the other way in the list of arcs
};

}  // namespace

std::int64_t MinCut::to_units(double cost) {
  constexpr double kUnits = 64, kMost = 1e15;
  return std::llround(kUnits * std::clamp(cost, -kMost, kMost));
}

std::vector<std::uint8_t> MinCut::solve() const {
  const auto n = std::uint32_t(take_over_keep_.size());
  const std::uint32_t source = n, sink = n + 1;  // label 0 stays with the source
  std::vector<Arc> arcs;
  arcs.reserve(2 * (links_.size() + n));
  const auto add = [&](std::uint32_t a, std::uint32_t b, std::int64_t forward, std::int64_t backward) {
    const auto place = std::uint32_t(arcs.size());
    arcs.push_back({a, b, forward, place + 1});
    arcs.push_back({b, a, backward, place});
  };
  for (const Link& link : links_) add(link.a, link.b, link.forward, link.backward);
  for (std::uint32_t i = 0; i < n; ++i)
    take_over_keep_[i] >= 0 ? add(source, i, take_over_keep_[i], 0) : add(i, sink, -take_over_keep_[i], 0);

  // By the node that they leave, as the graph keeps them.
  std::vector<std::uint32_t> order(arcs.size()), place(arcs.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t x, std::uint32_t y) { return arcs[x].from < arcs[y].from; });
  std::vector<std::pair<std::uint32_t, std::uint32_t>> ends;
  std::vector<std::int64_t> capacity;
  for (const std::uint32_t k : order) {
    place[k] = std::uint32_t(ends.size());
    ends.emplace_back(arcs[k].from, arcs[k].to);
    capacity.push_back(arcs[k].capacity);
  }
  const Graph graph(boost::edges_are_sorted, ends.begin(), ends.end(), n + 2);
  std::vector<Edge> edges;
  for (const Edge& edge : boost::make_iterator_range(boost::edges(graph))) edges.push_back(edge);
  std::vector<Edge> reverse;
  for (const std::uint32_t k : order) reverse.push_back(edges[place[arcs[k].pair]]);

  std::vector<std::int64_t> residual(ends.size());
  std::vector<Edge> predecessor(n + 2);
  std::vector<boost::default_color_type> color(n + 2);
  std::vector<std::uint32_t> distance(n + 2);
  const auto edge_index = boost::get(boost::edge_index, graph);
  const auto vertex_index = boost::get(boost::vertex_index, graph);
  boost::boykov_kolmogorov_max_flow(graph, boost::make_iterator_property_map(capacity.begin(), edge_index),
                                    boost::make_iterator_property_map(residual.begin(), edge_index),
                                    boost::make_iterator_property_map(reverse.begin(), edge_index),
                                    boost::make_iterator_property_map(predecessor.begin(), vertex_index),
                                    boost::make_iterator_property_map(color.begin(), vertex_index),
                                    boost::make_iterator_property_map(distance.begin(), vertex_index), vertex_index,
                                    source, sink);
  // Which nodes the source's tree holds depends on the search; what the sink can be reached from does not.
  std::vector<std::uint8_t> label(n, 0);
  std::vector<std::uint32_t> front;
  const auto reach = [&](std::uint32_t node) {
    for (const Edge& back : boost::make_iterator_range(boost::out_edges(node, graph))) {
      const std::size_t k = get(edge_index, back);
      const std::uint32_t other = boost::target(back, graph);
      const std::size_t toward = get(edge_index, reverse[k]);
      if (other < n && !label[other] && residual[toward] > 0) label[other] = 1, front.push_back(other);
    }
  };
  reach(sink);
  while (!front.empty()) {
    const std::uint32_t node = front.back();
    front.pop_back();
    reach(node);
  }
  return label;
}

}  // namespace lapseam
