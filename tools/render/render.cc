#include "tools/render/render.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <embree3/rtcore.h>
#include <limits>
#include <memory>
#include <new>
#include <numbers>
#include <optional>
#include <sys/mman.h>
#include <system_error>
#include <thread>

#include "tools/generate/noise.h"

namespace mtdb {
namespace {

constexpr int kMaxPixels = 16384;
constexpr int kSubpixels = 3;  // along each axis
constexpr int kSamples = kSubpixels * kSubpixels;
constexpr int kAmbientRays = 3;       // a sample
constexpr float kKeyRadius = 0.11f;   // of the light, at distance 1
constexpr double kViewAngle = 0.42;   // radians, across the shorter side
constexpr double kFill = 0.90;        // share of the picture that the frame fills
constexpr float kEdgePixels = 0.55f;  // half the width of a line
constexpr float kFadedPixels = 2.5f;  // lines of triangles of this size have faded ...
constexpr float kFullPixels = 9.0f;   // ... and are full from here

Vec3f ToFloat(Vec3d v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}
Vec3f Scaled(Vec3f a, Vec3f b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
Vec3f Mix(Vec3f a, Vec3f b, float t) { return a * (1 - t) + b * t; }
float Norm(Vec3f v) { return std::sqrt(Dot(v, v)); }
Vec3f Unit(Vec3f v) {
  const float n = Norm(v);
  return n > 0 ? v * (1 / n) : Vec3f{0, 0, 1};
}

bool HasAddressSpace(size_t bytes) {
  void* const space = ::mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (space == MAP_FAILED) return false;
  ::munmap(space, bytes);
  return true;
}

float SmoothStep(float low, float high, float x) {
  const float t = std::clamp((x - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3 - 2 * t);
}

// Two unit vectors that complete the unit vector n to a frame.
void Complete(Vec3f n, Vec3f* u, Vec3f* v) {
  *u = Unit(Cross(std::fabs(n.z) < 0.9f ? Vec3f{0, 0, 1} : Vec3f{1, 0, 0}, n));
  *v = Cross(n, *u);
}

// Embree's handles.
struct DeviceRelease {
  void operator()(RTCDevice d) const { rtcReleaseDevice(d); }
};
struct SceneRelease {
  void operator()(RTCScene s) const { rtcReleaseScene(s); }
};
using Device = std::unique_ptr<std::remove_pointer_t<RTCDevice>, DeviceRelease>;
using Scene = std::unique_ptr<std::remove_pointer_t<RTCScene>, SceneRelease>;

// The mesh as float32, moved to the origin and scaled to unit size: no digits are lost to
// coordinates far from the origin.
class Geometry {
 public:
  Status Load(const TriangleMesh& mesh) {
    if (mesh.triangles.empty()) {
      return InvalidArgument("nothing to draw: the mesh has no triangles; ask for a larger region");
    }
    for (size_t t = 0; t < mesh.triangles.size(); ++t) {
      for (const VertexIndex v : mesh.triangles[t]) {
        if (v >= mesh.positions.size() || v >= kNone32) {
          return InvalidArgument("triangle " + std::to_string(t) + " names vertex " +
                                 std::to_string(v) + ", but the mesh has " +
                                 std::to_string(mesh.positions.size()));
        }
        const Vec3d p = mesh.positions[v];
        if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
          return InvalidArgument("vertex " + std::to_string(v) + " is not finite");
        }
        bounds_.Add(p);
      }
    }
    const double size = Diagonal(bounds_);
    if (!std::isfinite(size)) return InvalidArgument("the mesh is too large to be drawn");
    centre_ = (bounds_.min + bounds_.max) * 0.5;
    scale_ = size > 0 ? 1 / size : 1;
    LoadColours(mesh);
    return BuildScene(mesh);
  }

  RTCScene scene() const { return scene_.get(); }
  Vec3d FromModel(Vec3d p) const { return (p - centre_) * scale_; }
  // Calls `visit` with every corner of every triangle.
  template <typename Visit>
  void ForEachCorner(Visit visit) const {
    for (const uint32_t v : triangles_)
      visit(Vec3d{vertices_[v].x, vertices_[v].y, vertices_[v].z});
  }
  Vec3f Vertex(uint32_t triangle, size_t corner) const {
    return vertices_[triangles_[size_t{triangle} * 3 + corner]];
  }
  // Linear colour at the barycentric coordinates of corners 1 and 2.
  Vec3f Colour(uint32_t triangle, float u, float v) const {
    if (colours_.empty()) return Vec3f{0.66f, 0.60f, 0.52f};
    const uint32_t* t = &triangles_[size_t{triangle} * 3];
    return colours_[t[0]] * (1 - u - v) + colours_[t[1]] * u + colours_[t[2]] * v;
  }

 private:
  void LoadColours(const TriangleMesh& mesh) {
    const std::vector<VertexAttribute>& attributes = mesh.header.attributes.attributes;
    const size_t row = mesh.header.attributes.row_bytes();
    std::optional<size_t> at[3];
    size_t offset = 0;
    for (const VertexAttribute& a : attributes) {
      const char* const names[3] = {"red", "green", "blue"};
      for (int c = 0; c < 3; ++c) {
        if (a.name == names[c] && a.type == ScalarType::kUint8) at[c] = offset;
      }
      offset += ScalarSize(a.type);
    }
    if (!at[0] || !at[1] || !at[2] || mesh.rows.size() < row * mesh.positions.size()) return;
    colours_.resize(mesh.positions.size());
    for (size_t v = 0; v < colours_.size(); ++v) {
      for (int c = 0; c < 3; ++c) {
        const auto byte = static_cast<float>(mesh.rows[v * row + *at[c]]) / 255;
        colours_[v][c] = std::pow(byte, 2.2f);
      }
    }
  }

  Status BuildScene(const TriangleMesh& mesh) {
    // Embree may end the process when it finds no memory: it is asked only when there is plenty,
    // and works on this thread alone.
    constexpr size_t kOfEmbree = size_t{128} << 20;
    constexpr size_t kOfTriangle = 512;
    if (!HasAddressSpace(kOfEmbree + kOfTriangle * mesh.triangles.size())) {
      return Status(StatusCode::kNoSpace, "not enough memory to draw " +
                                              std::to_string(mesh.triangles.size()) +
                                              " triangles; ask for fewer, or give more memory");
    }
    device_.reset(rtcNewDevice("threads=1,user_threads=1"));
    if (device_ == nullptr) return Status(StatusCode::kNoSpace, "Embree cannot start");
    scene_.reset(rtcNewScene(device_.get()));
    if (scene_ == nullptr) return Status(StatusCode::kNoSpace, "Embree has no memory for a scene");
    rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST);
    RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    if (geometry == nullptr) return Status(StatusCode::kNoSpace, "Embree has no memory for a mesh");
    // Embree reads 16 bytes at a vertex: one more at the end.
    vertices_.resize(mesh.positions.size() + 1);
    for (size_t v = 0; v < mesh.positions.size(); ++v) {
      vertices_[v] = ToFloat(FromModel(mesh.positions[v]));
    }
    triangles_.reserve(mesh.triangles.size() * 3);
    for (const TriangleVertices& t : mesh.triangles) {
      for (const VertexIndex v : t) triangles_.push_back(static_cast<uint32_t>(v));
    }
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               vertices_.data(), 0, sizeof(Vec3f), mesh.positions.size());
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               triangles_.data(), 0, 3 * sizeof(uint32_t), mesh.triangles.size());
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_.get(), geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_.get());
    if (rtcGetDeviceError(device_.get()) != RTC_ERROR_NONE) {
      return Status(StatusCode::kNoSpace, "Embree cannot hold " +
                                              std::to_string(mesh.triangles.size()) +
                                              " triangles; ask for fewer");
    }
    return Status::Ok();
  }

  Box3d bounds_;
  Vec3d centre_;
  double scale_ = 1;
  std::vector<Vec3f> vertices_;
  std::vector<uint32_t> triangles_;
  std::vector<Vec3f> colours_;
  Device device_;
  Scene scene_;
};

// A perspective view in the geometry's coordinates.
struct View {
  Vec3f eye, forward, right, up;
  float pixel = 0;  // size of a pixel at distance 1
  float width = 0, height = 0;

  Vec3f Direction(float x, float y) const {
    return Unit(forward + right * ((x - width / 2) * pixel) + up * ((height / 2 - y) * pixel));
  }
};

View ViewOf(const Geometry& geometry, const Camera& camera, int width, int height) {
  const Camera::Axes axes = camera.axes();
  View view;
  view.eye = ToFloat(geometry.FromModel(camera.eye));
  view.forward = ToFloat(axes.forward);
  view.right = ToFloat(axes.right);
  view.up = ToFloat(axes.up);
  view.pixel = static_cast<float>(2 * camera.tangent_y() / height);
  view.width = static_cast<float>(width);
  view.height = static_cast<float>(height);
  return view;
}

Result<View> PlaceView(const Geometry& geometry, const RenderOptions& options) {
  if (options.camera) {
    MTDB_RETURN_IF_ERROR(options.camera->Validate());
    return ViewOf(geometry, *options.camera, options.width, options.height);
  }
  const Vec3d direction = options.view_direction;
  const double length = Length(direction);
  if (!(length > 0) || !std::isfinite(length)) {
    return InvalidArgument("the view direction must be a finite vector other than 0");
  }
  const Vec3d forward = direction * (1 / length);
  const Vec3d helper = std::fabs(forward.z) < 0.999 ? Vec3d{0, 0, 1} : Vec3d{0, 1, 0};
  Vec3d right = Cross(forward, helper);
  right = right * (1 / Length(right));
  const Vec3d up = Cross(right, forward);
  const Box3d* box = options.frame ? &*options.frame : nullptr;
  if (box != nullptr && (box->empty() || !std::isfinite(Diagonal(*box)))) {
    return InvalidArgument("the frame of the picture must be a box that is not empty");
  }
  const double tangent = std::tan(kViewAngle / 2) * kFill;
  const double shorter = std::min(options.width, options.height);
  const double tangent_x = tangent * options.width / shorter;
  const double tangent_y = tangent * options.height / shorter;
  // The nearest eye from which all points are in sight, moved sideways until the picture is
  // balanced: on each side the point that binds tells where the eye may be.
  double left = -1e300, right_side = -1e300, low = -1e300, high = -1e300;
  const auto add = [&](Vec3d p) {
    const double depth = Dot(p, forward);
    right_side = std::max(right_side, Dot(p, right) - depth * tangent_x);
    left = std::max(left, -Dot(p, right) - depth * tangent_x);
    high = std::max(high, Dot(p, up) - depth * tangent_y);
    low = std::max(low, -Dot(p, up) - depth * tangent_y);
  };
  if (box != nullptr) {
    for (int c = 0; c < 8; ++c) {
      add(geometry.FromModel({c & 1 ? box->max.x : box->min.x, c & 2 ? box->max.y : box->min.y,
                              c & 4 ? box->max.z : box->min.z}));
    }
  } else {
    geometry.ForEachCorner(add);
  }
  const double back =
      std::max({(left + right_side) / (2 * tangent_x), (low + high) / (2 * tangent_y), -1e3});
  View view;
  view.eye = ToFloat(right * ((right_side - left) / 2) + up * ((high - low) / 2) -
                     forward * (back + 1e-4));
  view.forward = ToFloat(forward);
  view.right = ToFloat(right);
  view.up = ToFloat(up);
  view.pixel = static_cast<float>(2 * std::tan(kViewAngle / 2) / shorter);
  view.width = static_cast<float>(options.width);
  view.height = static_cast<float>(options.height);
  return view;
}

class Painter {
 public:
  Painter(const Geometry& geometry, const View& view, const RenderOptions& options)
      : geometry_(geometry), view_(view), wireframe_(options.wireframe) {
    // The key light comes from above the viewer's left shoulder, a rim light from behind.
    key_ = Unit(view.right * -0.80f + view.up * 0.36f - view.forward * 0.26f + Vec3f{0, 0, 0.35f});
    rim_ = Unit(view.right * 0.85f + view.up * 0.25f + view.forward * 0.45f);
  }

  void PaintRow(int y, uint8_t* rgb) const {
    const int width = static_cast<int>(view_.width);
    for (int x = 0; x < width; ++x) {
      Vec3f sum;
      const auto pixel_seed = static_cast<uint32_t>(
          MixBits(static_cast<uint64_t>(y) * kMaxPixels + static_cast<uint64_t>(x)));
      for (int s = 0; s < kSamples; ++s) {
        const int column = s % kSubpixels, row = s / kSubpixels;
        const float sx = static_cast<float>(x) + (static_cast<float>(column) + 0.5f) / kSubpixels;
        const float sy = static_cast<float>(y) + (static_cast<float>(row) + 0.5f) / kSubpixels;
        sum += ToneMap(Trace(sx, sy, s, pixel_seed));
      }
      // Grey noise below one step of a byte hides the steps of the background's gradient.
      const float dither = UnitFloat(pixel_seed) - 0.5f;
      for (int c = 0; c < 3; ++c) {
        const float value = sum[c] * (255.0f / kSamples) + 0.5f + dither * 0.8f;
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
    const float dx = x / view_.width - 0.5f, dy = y / view_.height - 0.46f;
    const float t = std::clamp((dx * dx + dy * dy) * 1.9f, 0.0f, 1.0f);
    return Mix(Vec3f{0.200f, 0.215f, 0.235f}, Vec3f{0.036f, 0.041f, 0.050f}, std::sqrt(t));
  }

  bool Occluded(Vec3f from, Vec3f direction, float reach) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRay ray{};
    ray.org_x = from.x;
    ray.org_y = from.y;
    ray.org_z = from.z;
    ray.dir_x = direction.x;
    ray.dir_y = direction.y;
    ray.dir_z = direction.z;
    ray.tfar = reach;
    ray.mask = ~0u;
    rtcOccluded1(geometry_.scene(), &context, &ray);
    return ray.tfar < 0;
  }

  Vec3f Trace(float x, float y, int sample, uint32_t pixel_seed) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    const Vec3f direction = view_.Direction(x, y);
    RTCRayHit hit{};
    hit.ray.org_x = view_.eye.x;
    hit.ray.org_y = view_.eye.y;
    hit.ray.org_z = view_.eye.z;
    hit.ray.dir_x = direction.x;
    hit.ray.dir_y = direction.y;
    hit.ray.dir_z = direction.z;
    hit.ray.tfar = std::numeric_limits<float>::infinity();
    hit.ray.mask = ~0u;
    hit.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(geometry_.scene(), &context, &hit);
    if (hit.hit.geomID == RTC_INVALID_GEOMETRY_ID) return Background(x, y);

    const uint32_t triangle = hit.hit.primID;
    Vec3f normal = Unit({hit.hit.Ng_x, hit.hit.Ng_y, hit.hit.Ng_z});
    Vec3f albedo = geometry_.Colour(triangle, hit.hit.u, hit.hit.v);
    if (Dot(normal, direction) > 0) {
      normal = normal * -1.0f;
      albedo = Scaled(albedo, {0.55f, 0.72f, 1.0f});
    }
    const float distance = hit.ray.tfar;
    const Vec3f at = view_.eye + direction * distance + normal * (2e-6f * (1 + distance));
    Vec3f light = Light(at, normal, direction, sample, pixel_seed);
    if (wireframe_) {
      const float ink = EdgeInk(triangle, hit.hit.u, hit.hit.v, direction, distance);
      albedo = albedo * (1 - 0.86f * ink);
    }
    return Scaled(albedo, light);
  }

  // `sample` numbers the samples of a pixel, whose rays together cover the lights evenly; the two
  // turns differ from pixel to pixel.
  Vec3f Light(Vec3f at, Vec3f normal, Vec3f direction, int sample, uint32_t pixel_seed) const {
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
    if (facing > 0 && !Occluded(at, key, 4)) {
      const Vec3f half = Unit(key - direction);
      const float shine = std::pow(std::max(0.0f, Dot(normal, half)), 24.0f);
      light += Vec3f{1.72f, 1.54f, 1.27f} * (facing + 0.06f * shine);
    }
    const float rim = Dot(normal, rim_);
    if (rim > 0) light += Vec3f{0.16f, 0.23f, 0.36f} * rim;
    // The sky, as far as it is in sight: rays by the cosine around the normal.
    Complete(normal, &u, &v);
    for (int i = 0; i < kAmbientRays; ++i) {
      spread(i * kSamples + sample, kSamples * kAmbientRays, &radius, &angle);
      const Vec3f d = u * (radius * std::cos(angle)) + v * (radius * std::sin(angle)) +
                      normal * std::sqrt(std::max(0.0f, 1 - radius * radius));
      if (Occluded(at, d, 0.5f)) continue;
      light += Mix(Vec3f{0.20f, 0.17f, 0.15f}, Vec3f{0.36f, 0.42f, 0.52f}, 0.5f + 0.5f * d.z) *
               (1.0f / kAmbientRays);
    }
    return light;
  }

  // How much of the sample the triangle's edges cover, 0..1, from distances on the screen.
  float EdgeInk(uint32_t triangle, float u, float v, Vec3f direction, float distance) const {
    const Vec3f a = geometry_.Vertex(triangle, 0);
    const Vec3f corner[3] = {a, geometry_.Vertex(triangle, 1), geometry_.Vertex(triangle, 2)};
    const Vec3f at = corner[0] * (1 - u - v) + corner[1] * u + corner[2] * v;
    // Seen along the ray, a length counts across it only; a pixel has this size at the hit.
    const float pixel = view_.pixel * distance * Dot(direction, view_.forward);
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

  const Geometry& geometry_;
  const View& view_;
  bool wireframe_;
  Vec3f key_, rim_;
};

}  // namespace

Status RenderMesh(const TriangleMesh& mesh, const RenderOptions& options, RenderImage* image) {
  if (options.width < 1 || options.height < 1 || options.width > kMaxPixels ||
      options.height > kMaxPixels) {
    return InvalidArgument("a picture of " + std::to_string(options.width) + "x" +
                           std::to_string(options.height) +
                           " pixels cannot be drawn; ask for 1 to 16384 each");
  }
  Geometry geometry;
  MTDB_RETURN_IF_ERROR(geometry.Load(mesh));
  MTDB_ASSIGN_OR_RETURN(const View view, PlaceView(geometry, options));
  const Painter painter(geometry, view, options);
  image->width = options.width;
  image->height = options.height;
  const size_t row_bytes = 3 * static_cast<size_t>(options.width);
  image->rgb.assign(row_bytes * static_cast<size_t>(options.height), 0);
  std::atomic<int> next_row{0};
  const auto paint = [&] {
    for (int y = next_row++; y < options.height; y = next_row++) {
      painter.PaintRow(y, image->rgb.data() + row_bytes * static_cast<size_t>(y));
    }
  };
  std::vector<std::jthread> helpers;
  try {
    for (unsigned i = 1; i < std::thread::hardware_concurrency(); ++i) helpers.emplace_back(paint);
  } catch (const std::system_error&) {  // as many as the system gives
  } catch (const std::bad_alloc&) {
  }
  paint();
  helpers.clear();
  return Status::Ok();
}

}  // namespace mtdb
