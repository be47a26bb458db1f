#pragma once

// Random numbers that are functions of their place, not of an order of drawing: the k-th number of (seed, stream, a,
// b).

#include <cmath>
#include <cstdint>
#include <numbers>

namespace lapseam::simulation {

/// Finaliser of SplitMix64 (Steele, Lea, Flood 2014): every input bit moves every output bit.
inline std::uint64_t mix_bits(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15u;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}

/// What a stream of numbers is for; keeps e.g. dropouts independent of noise.
enum class Stream : std::uint64_t { kNoise = 1, kDropout, kPose, kExposure, kTrajectory, kRoom, kSurface };

class CounterRng {
 public:
  CounterRng(std::uint64_t seed, Stream stream, std::uint64_t a = 0, std::uint64_t b = 0)
      : key_(mix_bits(mix_bits(mix_bits(seed + 0x5851F42D4C957F2Du) ^ std::uint64_t(stream)) + a) ^
             mix_bits(b + 0x14057B7EF767814Fu)) {}

  std::uint64_t bits(std::uint64_t k) const { return mix_bits(key_ + k * 0xD1342543DE82EF95u); }
  /// In [0, 1).
  double uniform(std::uint64_t k) const { return double(bits(k) >> 11) * 0x1p-53; }
  double uniform(std::uint64_t k, double low, double high) const { return low + (high - low) * uniform(k); }
  /// Standard normal, by Box and Muller; uses the numbers 2k and 2k + 1.
  double gaussian(std::uint64_t k) const {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform(2 * k)));
    return radius * std::cos(2.0 * std::numbers::pi * uniform(2 * k + 1));
  }

 private:
  std::uint64_t key_;
};

/// The same numbers one after another, for code that builds things in a fixed order.
class Dice {
 public:
  explicit Dice(std::uint64_t seed, Stream stream) : rng_(seed, stream) {}
  double between(double low, double high) { return rng_.uniform(next_++, low, high); }
  int index(int count) { return int(rng_.bits(next_++) % std::uint64_t(count)); }
  std::uint32_t seed() { return std::uint32_t(rng_.bits(next_++)); }

 private:
  CounterRng rng_;
  std::uint64_t next_ = 0;
};

}  // namespace lapseam::simulation
