#include "register/brightness.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lapseam {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
// Added to brightness of 0 to 1 before the logarithm, so that noise in the dark does not count more than light.
constexpr float kDark = 0.05f;
// What is kept of a picture has no more pixels, since all pictures are kept throughout. After halving there are still
// five for each surfel of the finest level: half the distance of surfels is the least that is asked for.
constexpr std::size_t kMostPixels = 500'000;

class Pictures {
 public:
  explicit Pictures(const ViewPicture& picture)
      : camera_(picture.camera),
        T_color_view_(picture.T_view_color.inverse(Eigen::Isometry).cast<float>()),
        spacing_(spacing_line(picture.camera)) {
    const ColorImage& image = picture.image;
    Image<float> level(image.width, image.height);
    for (std::size_t i = 0; i < image.size(); ++i) {
      const Rgb8 c = image.pixels[i];
      level.pixels[i] = (0.299f * float(c.r) + 0.587f * float(c.g) + 0.114f * float(c.b)) / 255;
    }
    for (; level.size() > kMostPixels && can_halve(level); ++first_level_) level = halve(level);
    levels_.push_back(std::move(level));
    while (can_halve(levels_.back())) levels_.push_back(halve(levels_.back()));
  }

  float at(const Eigen::Vector3f& point_in_view, float size_m) const {
    const auto seen = project(camera_, (T_color_view_ * point_in_view).cast<double>());
    if (!seen) return kNone;
    const double footprint_px = double(size_m) / spacing_.at(seen->r);
    const int wanted = footprint_px > 1 ? int(std::floor(std::log2(footprint_px))) : 0;
    const int k = std::clamp(wanted, first_level_, first_level_ + int(levels_.size()) - 1);
    const double scale = 1.0 / double(1 << k);
    const Image<float>& level = levels_[std::size_t(k - first_level_)];
    const float value = interpolate(level, (seen->u + 0.5) * scale - 0.5, (seen->v + 0.5) * scale - 0.5);
    return std::log(value + kDark);
  }

 private:
  static bool can_halve(const Image<float>& image) { return image.width >= 16 && image.height >= 16; }

  static Image<float> halve(const Image<float>& from) {
    Image<float> out(from.width / 2, from.height / 2);
    for (int v = 0; v < out.height; ++v)
      for (int u = 0; u < out.width; ++u)
        out.at(u, v) = 0.25f * (from.at(2 * u, 2 * v) + from.at(2 * u + 1, 2 * v) + from.at(2 * u, 2 * v + 1) +
                                from.at(2 * u + 1, 2 * v + 1));
    return out;
  }

  static float interpolate(const Image<float>& image, double u, double v) {
    if (!(u >= 0) || !(v >= 0) || !(u < image.width - 1) || !(v < image.height - 1)) return kNone;
    const int u0 = int(u), v0 = int(v);
    const auto s = float(u - u0), t = float(v - v0);
    return (1 - t) * ((1 - s) * image.at(u0, v0) + s * image.at(u0 + 1, v0)) +
           t * ((1 - s) * image.at(u0, v0 + 1) + s * image.at(u0 + 1, v0 + 1));
  }

  Sensor camera_;
  Eigen::Isometry3f T_color_view_;
  SpacingLine spacing_;
  int first_level_ = 0;  // how often the picture was halved before the first that is kept
  std::vector<Image<float>> levels_;
};

}  // namespace

BrightnessAt make_brightness(const ViewPicture& picture) {
  return [pictures = std::make_shared<const Pictures>(picture)](const Eigen::Vector3f& point_in_view, float size_m) {
    return pictures->at(point_in_view, size_m);
  };
}

}  // namespace lapseam
