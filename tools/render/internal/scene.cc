// SPDX-License-Identifier: Apache-2.0
#include "tools/render/internal/scene.h"

#include <algorithm>
#include <limits>
#include <string>
#include <sys/mman.h>

namespace mtdb::internal {

namespace {

constexpr float kEdgeCosine = 0.64f;  // of the angle between a face and a smooth normal
constexpr float kCoincident = 3e-6f;  // of 1 + distance

bool HasAddressSpace(size_t bytes) {
  void* const space = ::mmap(nullptr, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (space == MAP_FAILED) return false;
  ::munmap(space, bytes);
  return true;
}

void SetRay(RTCRay* ray, Vec3f from, Vec3f direction, float nearest, float farthest) {
  ray->org_x = from.x;
  ray->org_y = from.y;
  ray->org_z = from.z;
  ray->dir_x = direction.x;
  ray->dir_y = direction.y;
  ray->dir_z = direction.z;
  ray->tnear = nearest;
  ray->tfar = farthest;
  ray->mask = ~0u;
}

// What lies between two distances along a ray: the filter sees every triangle there, and notes the
// one that is shown.
struct Choice {
  RTCIntersectContext context{};  // first: the filter finds this by it
  bool found = false, front = false;
  Hit hit;
};

void Choose(const RTCFilterFunctionNArguments* arguments) {
  auto* const choice = reinterpret_cast<Choice*>(arguments->context);
  const auto* const ray = reinterpret_cast<const RTCRay*>(arguments->ray);
  const auto* const hit = reinterpret_cast<const RTCHit*>(arguments->hit);
  arguments->valid[0] = 0;  // go on
  const bool front = hit->Ng_x * ray->dir_x + hit->Ng_y * ray->dir_y + hit->Ng_z * ray->dir_z <= 0;
  const bool better = !choice->found || (front && !choice->front) ||
                      (front == choice->front && hit->primID < choice->hit.triangle);
  if (!better) return;
  choice->found = true;
  choice->front = front;
  choice->hit = {hit->primID, hit->u, hit->v, ray->tfar};
}

struct Closest {
  const Scene* scene;
  Vec3d point;
  double squared;
};

bool Compare(RTCPointQueryFunctionArguments* arguments) {
  auto* const closest = static_cast<Closest*>(arguments->userPtr);
  const auto corner = [&](size_t c) {
    const Vec3f v = closest->scene->Vertex(arguments->primID, c);
    return Vec3d{v.x, v.y, v.z};
  };
  const double squared =
      SquaredDistancePointTriangle(closest->point, corner(0), corner(1), corner(2));
  if (!(squared < closest->squared)) return false;
  closest->squared = squared;
  arguments->query->radius = static_cast<float>(std::sqrt(squared) * 1.000001 + 1e-9);
  return true;
}

}  // namespace

Status Scene::Load(const TriangleMesh& mesh, const std::optional<SceneFrame>& frame) {
  if (mesh.triangles.empty()) {
    return InvalidArgument("nothing to draw: the mesh has no triangles; ask for a larger region");
  }
  Box3d bounds;
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
      bounds.Add(p);
    }
  }
  const double size = Diagonal(bounds);
  if (!std::isfinite(size)) return InvalidArgument("the mesh is too large to be drawn");
  frame_ = frame.value_or(SceneFrame{(bounds.min + bounds.max) * 0.5, size > 0 ? 1 / size : 1});
  return Build(mesh);
}

Status Scene::Build(const TriangleMesh& mesh) {
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
  rtcSetSceneFlags(
      scene_.get(),
      static_cast<RTCSceneFlags>(RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION));
  RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
  if (geometry == nullptr) return Status(StatusCode::kNoSpace, "Embree has no memory for a mesh");
  vertices_.resize(mesh.positions.size() + 1);
  for (size_t v = 0; v < mesh.positions.size(); ++v) {
    vertices_[v] = ToFloat(frame_.FromModel(mesh.positions[v]));
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

void Scene::FindNormals() {
  normals_.assign(vertices_.size(), Vec3f{});
  for (size_t i = 0; i < triangles_.size(); i += 3) {
    const auto t = static_cast<uint32_t>(i / 3);
    const Vec3f face = FaceNormal(t);
    for (size_t c = 0; c < 3; ++c) {
      const Vec3f a = Unit(Vertex(t, (c + 1) % 3) - Vertex(t, c));
      const Vec3f b = Unit(Vertex(t, (c + 2) % 3) - Vertex(t, c));
      normals_[triangles_[i + c]] += face * std::acos(std::clamp(Dot(a, b), -1.0f, 1.0f));
    }
  }
  for (Vec3f& n : normals_) n = Unit(n);
}

Vec3f Scene::FaceNormal(uint32_t triangle) const {
  const Vec3f a = Vertex(triangle, 0);
  return Unit(Cross(Vertex(triangle, 1) - a, Vertex(triangle, 2) - a));
}

Vec3f Scene::CornerNormal(uint32_t triangle, size_t corner, Vec3f face) const {
  if (normals_.empty()) return face;
  const Vec3f smooth = normals_[VertexOf(triangle, corner)];
  return Dot(smooth, face) > kEdgeCosine ? smooth : face;
}

std::optional<Hit> Scene::FirstHit(Vec3f from, Vec3f direction) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit first{};
  SetRay(&first.ray, from, direction, 0, std::numeric_limits<float>::infinity());
  first.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene_.get(), &context, &first);
  if (first.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  const float distance = first.ray.tfar, near = kCoincident * (1 + distance);
  Choice choice;
  rtcInitIntersectContext(&choice.context);
  choice.context.filter = Choose;
  RTCRayHit again{};
  SetRay(&again.ray, from, direction, std::max(0.0f, distance - near), distance + near);
  again.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene_.get(), &choice.context, &again);
  if (choice.found) return choice.hit;
  return Hit{first.hit.primID, first.hit.u, first.hit.v, distance};
}

bool Scene::Occluded(Vec3f from, Vec3f direction, float reach) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray{};
  SetRay(&ray, from, direction, 0, reach);
  rtcOccluded1(scene_.get(), &context, &ray);
  return ray.tfar < 0;
}

double Scene::DistanceTo(Vec3f point) const {
  Closest closest{this, {point.x, point.y, point.z}, std::numeric_limits<double>::infinity()};
  RTCPointQueryContext context;
  rtcInitPointQueryContext(&context);
  RTCPointQuery query{};
  query.x = point.x;
  query.y = point.y;
  query.z = point.z;
  query.radius = std::numeric_limits<float>::infinity();
  rtcPointQuery(scene_.get(), &query, &context, Compare, &closest);
  return std::sqrt(closest.squared);
}

}  // namespace mtdb::internal
