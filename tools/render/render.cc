// SPDX-License-Identifier: Apache-2.0
#include "tools/render/render.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <new>
#include <numbers>
#include <system_error>
#include <thread>

#include "store/base/out_of_memory.h"
#include "tools/generate/noise.h"
#include "tools/render/internal/colours.h"
#include "tools/render/internal/draped_image.h"
#include "tools/render/internal/lettering.h"
#include "tools/render/internal/scene.h"
#include "tools/render/internal/texture_images.h"
#include "tools/render/view.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr int kMaxPixels = 16384;
constexpr int kSubpixels = 3;         // along each axis
constexpr int kAmbientRays = 3;       // a sample
constexpr float kKeyRadius = 0.11f;   // of the light, at distance 1
constexpr double kFill = 0.90;        // share of the picture that the frame fills
constexpr float kEdgePixels = 0.55f;  // half the width of a line
constexpr float kFadedPixels = 2.5f;  // lines of triangles of this size have faded ...
constexpr float kFullPixels = 9.0f;   // ... and are full from here
constexpr float kShade = 0.45f;       // of plain colours, where they are seen from the side

Vec3f Scaled(Vec3f a, Vec3f b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
Vec3f Mix(Vec3f a, Vec3f b, float t) { return a * (1 - t) + b * t; }

float SmoothStep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3 - 2 * t);
}

// Two unit vectors that complete the unit vector n to a frame.
void Complete(Vec3f n, Vec3f* u, Vec3f* v) {
  *u = Unit(Cross(std::fabs(n.z) < 0.9f ? Vec3f{0, 0, 1} : Vec3f{1, 0, 0}, n));
  *v = Cross(n, *u);
}

Vec3f Displayed(Rgb colour) {
  return {static_cast<float>(colour[0]) / 255, static_cast<float>(colour[1]) / 255,
          static_cast<float>(colour[2]) / 255};
}

// A perspective view in the scene's coordinates.
struct View {
  Vec3f eye, forward, right, up;
  float pixel = 0;  // size of a pixel at distance 1
  float width = 0, height = 0;
  float middle = 1;  // depth of the middle of what is framed

  Vec3f Direction(float x, float y) const {
    return Unit(forward + right * ((x - width / 2) * pixel) + up * ((height / 2 - y) * pixel));
  }
};

View ViewOf(const Scene& scene, const Camera& camera, const RenderOptions& options) {
  const Camera::Axes axes = camera.axes();
  View view;
  view.eye = ToFloat(scene.frame().FromModel(camera.eye));
  view.forward = ToFloat(axes.forward);
  view.right = ToFloat(axes.right);
  view.up = ToFloat(axes.up);
  view.pixel = static_cast<float>(2 * camera.tangent_y() / options.height);
  return view;
}

// The nearest eye from which all of the frame is in sight, moved sideways until the picture is
// balanced: on each side the point that binds tells where the eye may be.
View FittedView(const Scene& scene, Vec3d forward, Vec3d right, Vec3d up,
                const RenderOptions& options) {
  const double tangent = std::tan(options.view_angle_rad / 2) * kFill;
  const double shorter = std::min(options.width, options.height);
  const double tangent_x = tangent * options.width / shorter;
  const double tangent_y = tangent * options.height / shorter;
  double left = -1e300, right_side = -1e300, low = -1e300, high = -1e300;
  const auto add = [&](Vec3d p) {
    const double depth = Dot(p, forward);
    right_side = std::max(right_side, Dot(p, right) - depth * tangent_x);
    left = std::max(left, -Dot(p, right) - depth * tangent_x);
    high = std::max(high, Dot(p, up) - depth * tangent_y);
    low = std::max(low, -Dot(p, up) - depth * tangent_y);
  };
  for (const Vec3d p : options.frame) add(scene.frame().FromModel(p));
  if (options.frame.empty()) scene.ForEachCorner(add);
  const double back =
      std::max({(left + right_side) / (2 * tangent_x), (low + high) / (2 * tangent_y), -1e3});
  View view;
  view.eye = ToFloat(right * ((right_side - left) / 2) + up * ((high - low) / 2) -
                     forward * (back + 1e-4));
  view.forward = ToFloat(forward);
  view.right = ToFloat(right);
  view.up = ToFloat(up);
  view.pixel = static_cast<float>(2 * std::tan(options.view_angle_rad / 2) / shorter);
  return view;
}

float DepthOfMiddle(const Scene& scene, const View& view, const RenderOptions& options) {
  float nearest = std::numeric_limits<float>::max(), farthest = -nearest;
  const auto add = [&](Vec3d p) {
    const float depth = Dot(ToFloat(p) - view.eye, view.forward);
    nearest = std::min(nearest, depth);
    farthest = std::max(farthest, depth);
  };
  for (const Vec3d p : options.frame) add(scene.frame().FromModel(p));
  if (options.frame.empty()) scene.ForEachCorner(add);
  return (nearest + farthest) / 2;
}

Result<View> PlaceView(const Scene& scene, const RenderOptions& options) {
  View view;
  if (options.camera) {
    MTDB_RETURN_IF_ERROR(options.camera->Validate());
    view = ViewOf(scene, *options.camera, options);
  } else {
    const Vec3d direction = options.view_direction;
    const double length = Length(direction), up_length = Length(options.up);
    if (!(length > 0) || !std::isfinite(length) || !(up_length > 0) || !std::isfinite(up_length)) {
      return InvalidArgument("the view direction and up must be finite vectors other than 0");
    }
    for (const Vec3d p : options.frame) {
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
        return InvalidArgument("the frame of the picture must be of finite points");
      }
    }
    const Vec3d forward = direction * (1 / length);
    Vec3d right = Cross(forward, UpOfView(direction, options.up));
    right = right * (1 / Length(right));
    view = FittedView(scene, forward, right, Cross(right, forward), options);
  }
  view.width = static_cast<float>(options.width);
  view.height = static_cast<float>(options.height);
  view.middle = DepthOfMiddle(scene, view, options);
  return view;
}

// What a ray of the camera meets.
struct Sample {
  bool hit = false;
  Vec3f shown;  // display values, 0 .. 1
};

class Painter {
 public:
  // `texture` and `drape` may be null.
  Painter(const Scene& scene, const Colours& colours, const TextureImages* texture,
          const DrapedImage* drape, const View& view, const RenderOptions& options)
      : scene_(scene),
        colours_(colours),
        texture_(texture),
        drape_(drape),
        view_(view),
        options_(options),
        subpixels_(options.draft ? 1 : kSubpixels) {
    // The key light comes from above the viewer's left shoulder, a rim light from behind.
    top_ = options.camera ? ToFloat(options.camera->axes().up)
                          : Unit(ToFloat(options.up * (1 / Length(options.up))));
    key_ = Unit(view.right * -0.80f + view.up * 0.36f - view.forward * 0.26f + top_ * 0.35f);
    rim_ = Unit(view.right * 0.85f + view.up * 0.25f + view.forward * 0.45f);
  }

  // Of the middle of each pixel of the row; NaN where it shows nothing.
  void MeasureRow(int y, float* values) const {
    for (int x = 0; x < options_.width; ++x) {
      const Vec3f d = view_.Direction(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f);
      const std::optional<Hit> hit = scene_.FirstHit(view_.eye, d);
      values[x] = hit ? static_cast<float>(colours_.Value(*hit, view_.eye + d * hit->distance))
                      : std::numeric_limits<float>::quiet_NaN();
    }
  }

  // `values`: of MeasureRow, or null; `alpha` may be null.
  void PaintRow(int y, const float* values, uint8_t* rgb, uint8_t* alpha) const {
    const int samples = subpixels_ * subpixels_;
    for (int x = 0; x < options_.width; ++x) {
      Vec3f sum;
      int hits = 0;
      const auto pixel_seed = static_cast<uint32_t>(
          MixBits(static_cast<uint64_t>(y) * kMaxPixels + static_cast<uint64_t>(x)));
      for (int s = 0; s < samples; ++s) {
        const auto place = [&](int pixel, int part) {
          return static_cast<float>(pixel) +
                 (static_cast<float>(part) + 0.5f) / static_cast<float>(subpixels_);
        };
        const float sx = place(x, s % subpixels_), sy = place(y, s / subpixels_);
        const Sample sample =
            Trace(sx, sy, s, pixel_seed, values == nullptr ? nullptr : values + x);
        if (!sample.hit && alpha != nullptr) continue;
        sum += sample.hit ? sample.shown : Background(sx, sy);
        hits += sample.hit ? 1 : 0;
      }
      const int shown = alpha == nullptr ? samples : std::max(1, hits);
      if (alpha != nullptr) alpha[x] = static_cast<uint8_t>((hits * 255 + samples / 2) / samples);
      // Grey noise below one step of a byte hides the steps of the background's gradient.
      const bool noise = !colours_.plain() && !options_.background;
      const float dither = noise ? (UnitFloat(pixel_seed) - 0.5f) * 0.8f : 0;
      for (int c = 0; c < 3; ++c) {
        const float value = sum[c] * (255.0f / static_cast<float>(shown)) + 0.5f + dither;
        rgb[3 * x + c] = static_cast<uint8_t>(std::clamp(value, 0.0f, 255.0f));
      }
    }
  }

 private:
  // Linear light to display values, with a soft shoulder.
  static Vec3f ToneMap(Vec3f c) {
    for (int i = 0; i < 3; ++i) {
      const float x = std::max(c[i], 0.0f);
      const float rolled = x * (1 + x * 0.11f) / (1 + x * 0.36f);
      c[i] = std::pow(std::min(rolled, 1.0f), 1 / 2.2f);
    }
    return c;
  }

  Vec3f Background(float x, float y) const {
    if (options_.background) return Displayed(*options_.background);
    const float dx = x / view_.width - 0.5f, dy = y / view_.height - 0.46f;
    const float t = std::clamp((dx * dx + dy * dy) * 1.9f, 0.0f, 1.0f);
    return ToneMap(Mix(Vec3f{0.200f, 0.215f, 0.235f}, Vec3f{0.036f, 0.041f, 0.050f}, std::sqrt(t)));
  }

  Sample Trace(float x, float y, int sample, uint32_t pixel_seed, const float* value) const {
    const Vec3f direction = view_.Direction(x, y);
    const std::optional<Hit> hit = scene_.FirstHit(view_.eye, direction);
    if (!hit) return {};
    Vec3f face = scene_.FaceNormal(hit->triangle);
    Vec3f at = view_.eye + direction * hit->distance;
    const bool back = Dot(face, direction) > 0;
    Vec3f normal = face, lifted = at;
    if (options_.smooth) Smooth(*hit, face, &normal, &lifted);
    const float ink = options_.wireframe ? 0.86f * EdgeInk(*hit, direction) : 0;
    const Vec3f shown_normal = normal;
    if (back) {
      face = face * -1.0f;
      normal = normal * -1.0f;
      lifted = at;
    }
    if (colours_.plain()) {
      const float facing = std::fabs(Dot(normal, direction));
      const float light = (1 - kShade * (1 - facing)) * (1 - ink);
      return {true, PlainColour(*hit, at, shown_normal, value) * light};
    }
    Vec3f albedo = colours_.Albedo(*hit);
    if (texture_ != nullptr) albedo = Textured(albedo, *hit);
    if (drape_ != nullptr) albedo = Draped(albedo, at, hit->distance);
    if (back) albedo = Scaled(albedo, {0.55f, 0.72f, 1.0f});
    albedo = albedo * (1 - ink);
    if (options_.draft) {
      const float facing = std::max(0.0f, -Dot(normal, direction));
      return {true, ToneMap(albedo * (0.12f + 1.0f * facing * facing))};
    }
    lifted += face * (2e-6f * (1 + hit->distance));
    if (options_.hillshade && !back) {
      return {true, Shaded(albedo, MapLight(lifted, normal, face, sample, pixel_seed))};
    }
    return {true,
            ToneMap(Scaled(albedo, Light(lifted, normal, face, direction, sample, pixel_seed)))};
  }

  Vec3f Textured(Vec3f albedo, const Hit& hit) const {
    const Vec3f a = scene_.Vertex(hit.triangle, 0);
    const double area =
        Norm(Cross(scene_.Vertex(hit.triangle, 1) - a, scene_.Vertex(hit.triangle, 2) - a)) / 2;
    const double sample = double{view_.pixel} * hit.distance / subpixels_;
    return texture_->Over(albedo, hit.triangle, hit.u, hit.v, sample, area);
  }

  Vec3f Draped(Vec3f albedo, Vec3f at, float distance) const {
    const SceneFrame& frame = scene_.frame();
    const double sample = double{view_.pixel} * distance / subpixels_;
    return drape_->Over(albedo, at.x / frame.scale + frame.centre.x,
                        at.y / frame.scale + frame.centre.y, sample / frame.scale);
  }

  Vec3f PlainColour(const Hit& hit, Vec3f at, Vec3f normal, const float* value) const {
    if (colours_.by() == ColourBy::kNormal) return (normal + Vec3f{1, 1, 1}) * 0.5f;
    const bool known = value != nullptr && std::isfinite(*value);
    return Displayed(colours_.OfValue(known ? double{*value} : colours_.Value(hit, at)));
  }

  // The smooth normal, and the place on a smooth surface through the corners, from where shadows do
  // not show the triangles. After Hanika, "Hacking the Shadow Terminator" (2021).
  void Smooth(const Hit& hit, Vec3f face, Vec3f* normal, Vec3f* at) const {
    const float weights[3] = {1 - hit.u - hit.v, hit.u, hit.v};
    Vec3f sum, lifted;
    for (size_t c = 0; c < 3; ++c) {
      const Vec3f n = scene_.CornerNormal(hit.triangle, c, face);
      const Vec3f from_corner = *at - scene_.Vertex(hit.triangle, c);
      sum += n * weights[c];
      lifted += (*at - n * std::min(0.0f, Dot(from_corner, n))) * weights[c];
    }
    *normal = Unit(sum);
    *at = lifted;
  }

  // `sample` numbers the samples of a pixel, whose rays together cover the lights evenly; the two
  // turns differ from pixel to pixel.
  Vec3f Light(Vec3f at, Vec3f normal, Vec3f face, Vec3f direction, int sample,
              uint32_t pixel_seed) const {
    constexpr int kSamples = kSubpixels * kSubpixels;
    constexpr float kGolden = 0.61803399f, kTurn = 2 * std::numbers::pi_v<float>;
    const float shift = UnitFloat(pixel_seed);
    const float turn = UnitFloat(static_cast<uint32_t>(MixBits(pixel_seed)));
    const auto spread = [&](int i, int count, float* radius, float* angle) {
      const float along = (static_cast<float>(i) + shift) / static_cast<float>(count);
      *radius = std::sqrt(along);
      *angle = kTurn * (static_cast<float>(i) * kGolden + turn);
    };
    Vec3f light, u, v;
    float radius = 0, angle = 0;
    // The key light is a disc: soft shadows.
    Complete(key_, &u, &v);
    spread(sample, kSamples, &radius, &angle);
    const Vec3f key = Unit(key_ + u * (kKeyRadius * radius * std::cos(angle)) +
                           v * (kKeyRadius * radius * std::sin(angle)));
    const float facing = Dot(normal, key);
    if (facing > 0 && !scene_.Occluded(at, key, 4)) {
      const Vec3f half = Unit(key - direction);
      const float shine = std::pow(std::max(0.0f, Dot(normal, half)), 24.0f);
      light += Vec3f{1.72f, 1.54f, 1.27f} * (facing + 0.06f * shine);
    }
    const float rim = Dot(normal, rim_);
    if (rim > 0) light += Vec3f{0.16f, 0.23f, 0.36f} * rim;
    // The sky, as far as it is in sight: rays by the cosine around the normal.
    Complete(face, &u, &v);
    for (int i = 0; i < kAmbientRays; ++i) {
      spread(i * kSamples + sample, kSamples * kAmbientRays, &radius, &angle);
      const Vec3f d = u * (radius * std::cos(angle)) + v * (radius * std::sin(angle)) +
                      face * std::sqrt(std::max(0.0f, 1 - radius * radius));
      if (scene_.Occluded(at, d, 0.5f)) continue;
      light +=
          Mix(Vec3f{0.20f, 0.17f, 0.15f}, Vec3f{0.36f, 0.42f, 0.52f}, 0.5f + 0.5f * Dot(d, top_)) *
          (1.0f / kAmbientRays);
    }
    return light;
  }

  // A map's light on level ground is 1. North is along y, up along z. After Mark,
  // "Multidirectional, oblique-weighted, shaded-relief image of the Island of Hawaii" (USGS, 1992),
  // mixed with one light from the north-west.
  float MapLight(Vec3f at, Vec3f normal, Vec3f face, int sample, uint32_t pixel_seed) const {
    constexpr float kHigh = std::numbers::sqrt2_v<float> / 2;  // all stand at 45 degrees
    constexpr float kEighth = std::numbers::pi_v<float> / 4;
    const float aspect = std::atan2(normal.x, normal.y);
    float several = 0, one = 0;
    for (int i = -3; i <= 0; ++i) {  // south-west, west, north-west, north
      const float azimuth = kEighth * static_cast<float>(i);
      const Vec3f light{std::sin(azimuth) * kHigh, std::cos(azimuth) * kHigh, kHigh};
      const float facing = std::max(0.0f, Dot(normal, light));
      const float weight = std::sin(aspect - azimuth);
      several += 0.5f * weight * weight * facing;
      if (i == -1) one = facing;
    }
    const float lit = (0.4f * several + 0.6f * one) / kHigh;
    return std::max(0.06f, lit) * (0.45f + 0.55f * Sky(at, face, sample, pixel_seed));
  }

  // The share of the sky in sight from there, which level ground has all of.
  float Sky(Vec3f at, Vec3f face, int sample, uint32_t pixel_seed) const {
    constexpr int kCount = kSubpixels * kSubpixels * kAmbientRays;
    constexpr float kGolden = 0.61803399f, kTurn = 2 * std::numbers::pi_v<float>;
    const float turn = UnitFloat(static_cast<uint32_t>(MixBits(pixel_seed)));
    Vec3f u, v;
    Complete(face, &u, &v);
    int free = 0;
    for (int i = 0; i < kAmbientRays; ++i) {
      const auto number = static_cast<float>(i * kSubpixels * kSubpixels + sample);
      const float along = (number + UnitFloat(pixel_seed)) / static_cast<float>(kCount);
      const float radius = std::sqrt(along), angle = kTurn * (number * kGolden + turn);
      const Vec3f d = u * (radius * std::cos(angle)) + v * (radius * std::sin(angle)) +
                      face * std::sqrt(std::max(0.0f, 1 - along));
      free += scene_.Occluded(at, d, 0.3f) ? 0 : 1;
    }
    return static_cast<float>(free) / kAmbientRays;
  }

  // Paper under a map's light: shadows turn blue, and slopes that face the light pale.
  static Vec3f Shaded(Vec3f albedo, float light) {
    const float dark = std::clamp(1 - light, 0.0f, 1.0f), pale = std::clamp(light - 1, 0.0f, 0.6f);
    const Vec3f tinted = Scaled(albedo, Mix({1, 1, 1}, {0.72f, 0.84f, 1.12f}, dark));
    const Vec3f shown = Mix(tinted * std::min(light * light * 0.7f + light * 0.3f, 1.0f),
                            Vec3f{1.0f, 0.98f, 0.93f}, pale);
    Vec3f display;
    for (int c = 0; c < 3; ++c) display[c] = std::pow(std::clamp(shown[c], 0.0f, 1.0f), 1 / 2.2f);
    return display;
  }

  // How much of the sample the triangle's edges cover, 0..1, from distances on the screen.
  float EdgeInk(const Hit& hit, Vec3f direction) const {
    const Vec3f a = scene_.Vertex(hit.triangle, 0);
    const Vec3f corner[3] = {a, scene_.Vertex(hit.triangle, 1), scene_.Vertex(hit.triangle, 2)};
    const Vec3f at = corner[0] * (1 - hit.u - hit.v) + corner[1] * hit.u + corner[2] * hit.v;
    // Seen along the ray, a length counts across it only; a pixel has this size at the hit.
    const float pixel = view_.pixel * hit.distance * Dot(direction, view_.forward);
    const auto across = [&](Vec3f w) { return w - direction * Dot(w, direction); };
    float nearest = std::numeric_limits<float>::max();
    const float area = std::fabs(Dot(Cross(corner[1] - a, corner[2] - a), direction));
    for (size_t i = 0; i < 3; ++i) {
      const Vec3f edge = across(corner[(i + 1) % 3] - corner[i]);
      const float length = Norm(edge);
      if (length == 0) continue;
      nearest = std::min(nearest, Norm(Cross(across(at - corner[i]), edge)) / length);
    }
    const float line = 1 - SmoothStep(kEdgePixels * 0.6f, kEdgePixels * 1.5f, nearest / pixel);
    const float size = std::sqrt(2 * area) / pixel;
    return line * SmoothStep(kFadedPixels, kFullPixels, size);
  }

  const Scene& scene_;
  const Colours& colours_;
  const TextureImages* const texture_;
  const DrapedImage* const drape_;
  const View& view_;
  const RenderOptions& options_;
  const int subpixels_;
  Vec3f key_, rim_, top_;
};

// Calls work(y) for each row, by all cores.
template <typename Work>
void ForEachRow(int rows, Work work) {
  std::atomic<int> next_row{0};
  const auto go = [&] {
    for (int y = next_row++; y < rows; y = next_row++) work(y);
  };
  std::vector<std::jthread> helpers;
  try {
    for (unsigned i = 1; i < std::thread::hardware_concurrency(); ++i) helpers.emplace_back(go);
  } catch (const std::system_error&) {  // as many as the system gives
  } catch (const std::bad_alloc&) {
  }
  go();
}

Legend LegendOf(const RenderOptions& options, std::array<double, 2> range) {
  Legend legend{options.attribute, "", range[0], range[1]};
  if (options.colour == ColourBy::kDistance) legend.title = "error";
  if (options.colour == ColourBy::kHeight) {
    legend = {"height", options.height_units, range[0], range[1], TintOfHeight};
  }
  return legend;
}

void Paint(const Scene& scene, Colours& colours, const TextureImages* texture,
           const DrapedImage* drape, const View& view, const RenderOptions& options,
           RenderImage* image) {
  const Painter painter(scene, colours, texture, drape, view, options);
  const auto width = static_cast<size_t>(options.width);
  const size_t pixels = width * static_cast<size_t>(options.height);
  image->width = options.width;
  image->height = options.height;
  image->rgb.assign(3 * pixels, 0);
  image->alpha.assign(options.transparent ? pixels : 0, 0);
  std::vector<float> values;
  if (options.colour == ColourBy::kDistance) {
    values.resize(pixels);
    ForEachRow(options.height, [&](int y) {
      painter.MeasureRow(y, values.data() + width * static_cast<size_t>(y));
    });
    double most = 0;
    for (const float v : values) most = v > most ? v : most;
    if (!colours.range()) colours.set_range({0, most});
  }
  ForEachRow(options.height, [&](int y) {
    const size_t at = width * static_cast<size_t>(y);
    painter.PaintRow(y, values.empty() ? nullptr : values.data() + at, image->rgb.data() + 3 * at,
                     options.transparent ? image->alpha.data() + at : nullptr);
  });
  image->range = colours.range();
  if (colours.range() && options.legend) {
    DrawLegend(image, LegendOf(options, *colours.range()));
  }
  if (options.scale_bar && view.middle > 0) {
    DrawScaleBar(image, scene.frame().scale / (double{view.pixel} * view.middle));
  }
}

}  // namespace

std::vector<Vec3d> CornersOf(const Box3d& box) {
  std::vector<Vec3d> corners;
  for (int c = 0; c < 8; ++c) {
    corners.push_back({c & 1 ? box.max.x : box.min.x, c & 2 ? box.max.y : box.min.y,
                       c & 4 ? box.max.z : box.min.z});
  }
  return corners;
}

Status RenderMesh(const TriangleMesh& mesh, const RenderOptions& options, RenderImage* image) {
  if (options.width < 1 || options.height < 1 || options.width > kMaxPixels ||
      options.height > kMaxPixels) {
    return InvalidArgument("a picture of " + std::to_string(options.width) + "x" +
                           std::to_string(options.height) +
                           " pixels cannot be drawn; ask for 1 to 16384 each");
  }
  Scene scene;
  MTDB_RETURN_IF_ERROR(scene.Load(mesh));
  if (options.smooth) scene.FindNormals();
  Colours colours(scene);
  MTDB_RETURN_IF_ERROR(colours.Load(mesh, options));
  MTDB_ASSIGN_OR_RETURN(const View view, PlaceView(scene, options));
  DrapedImage drape;
  if (options.drape) {
    if (colours.plain()) {
      return InvalidArgument("an image cannot be draped where colours stand for values");
    }
    MTDB_RETURN_IF_ERROR(CatchOutOfMemory([&] { return drape.Load(*options.drape); }));
  }
  TextureImages texture;
  const bool textured = options.texture != nullptr && options.colour == ColourBy::kOwn;
  if (textured) MTDB_RETURN_IF_ERROR(texture.Load(mesh, options.texture));
  Paint(scene, colours, textured ? &texture : nullptr, options.drape ? &drape : nullptr, view,
        options, image);
  return texture.status();
}

}  // namespace mtdb
