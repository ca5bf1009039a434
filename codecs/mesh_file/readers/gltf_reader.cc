// SPDX-License-Identifier: Apache-2.0
// glTF 2.0, binary and JSON: the triangles of the default scene, each mesh where its nodes put it.
#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "codecs/mesh_file/polygons/mesh_emitter.h"
#include "codecs/mesh_file/polygons/scalar_row.h"
#include "codecs/mesh_file/readers/draco_mesh.h"
#include "codecs/mesh_file/readers/gltf_document.h"
#include "codecs/mesh_file/readers/readers.h"
#include "codecs/mesh_file/textures/gltf_textures.h"
#include "store/base/attribute_layout.h"
#include "store/base/vertex_meaning.h"

namespace mtdb::internal {

namespace {

// An affine map: the columns of its matrix, and what it adds.
struct Placement {
  Vec3d x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1}, shift;

  Vec3d Turned(Vec3d p) const { return p.x * x + p.y * y + p.z * z; }
  Vec3d operator()(Vec3d p) const { return Turned(p) + shift; }
  // After `inner`.
  Placement operator*(const Placement& inner) const {
    return {Turned(inner.x), Turned(inner.y), Turned(inner.z), (*this)(inner.shift)};
  }
  bool mirrors() const { return Dot(Cross(x, y), z) < 0; }
  // Of a normal; of the same length as before.
  Vec3d Normal(Vec3d n) const {
    const Vec3d turned = n.x * Cross(y, z) + n.y * Cross(z, x) + n.z * Cross(x, y);
    const double length = Length(turned);
    const double sign = mirrors() ? -1 : 1;
    return length > 0 ? (sign * Length(n) / length) * turned : n;
  }
  friend bool operator==(const Placement&, const Placement&) = default;
};

// What a primitive carries at its vertices.
struct Column {
  std::string name;  // of glTF: "NORMAL", "COLOR_0", "_QUALITY"
  int components = 1;
};

// The values of one attribute: of an accessor, or of a Draco mesh.
struct Source {
  std::optional<GltfValues> values;
  const DracoMesh* draco = nullptr;
  int attribute = 0;
  double scale = 1;         // from Draco's integers to numbers up to 1
  double colour_scale = 1;  // of a colour: from integers that are not said to be parts of one
};

// What glTF's integers of a type are parts of; 1 for floats.
double WholeOf(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8: return 127;
    case ScalarType::kUint8: return 255;
    case ScalarType::kInt16: return 32767;
    case ScalarType::kUint16: return 65535;
    default: return 1;
  }
}

class GltfReader {
 public:
  GltfReader(const InputFile& file, const ReaderSpace& tmp, MeshSink& sink, MeshReadReport* report)
      : file_(file), emitter_(sink), report_(report), table_(tmp) {}

  Status Read() {
    MTDB_ASSIGN_OR_RETURN(document_, GltfDocument::Open(file_));
    report_->format = "glTF";
    MTDB_RETURN_IF_ERROR(PlaceNodes());
    MTDB_RETURN_IF_ERROR(Plan());
    CountIgnored();
    MTDB_RETURN_IF_ERROR(emitter_.Begin(header_));
    for (const Placed& placed : placed_) {
      MTDB_RETURN_IF_ERROR(Emit(primitives_[placed.primitive], placed.placement));
    }
    AddWrongCorners(emitter_.wrong_corners(), report_);
    return emitter_.End();
  }

 private:
  struct Primitive {
    const GltfJson* json;
    std::string where;      // "mesh 1, primitive 0"
    uint64_t uses = 0;      // how many nodes place it
    bool is_moved = false;  // by one of them
    GltfTextureUse texture;
  };
  // A primitive where a node puts it.
  struct Placed {
    uint64_t primitive;
    Placement placement;
  };
  // A few bytes of nodes times a few of primitives could be any number.
  static constexpr uint64_t kMostPlaced = uint64_t{1} << 20;
  static constexpr uint64_t kNone = uint64_t{1} << 53;
  // Of a primitive, whose indices have 32 bits.
  static constexpr uint64_t kMostVertices = uint64_t{1} << 32;
  static constexpr uint64_t kTriangles = 4, kStrip = 5, kFan = 6;

  Status Error(const std::string& what) const { return document_->Error(what); }

  // Three or four numbers of a node.
  Status Numbers(const GltfJson* node, const char* key, std::span<double> values) const {
    const GltfJson* const list = GltfMember(node, key);
    if (list == nullptr) return Status::Ok();
    if (!list->is_array() || list->size() != values.size()) {
      return Error(std::string("a node's ") + key + " is no list of " +
                   std::to_string(values.size()) + " numbers");
    }
    for (size_t i = 0; i < values.size(); ++i) {
      if (!(*list)[i].is_number()) return Error(std::string("a node's ") + key + " is no number");
      values[i] = (*list)[i].get<double>();
    }
    return Status::Ok();
  }

  Status PlacementOf(const GltfJson* node, Placement* placement) const {
    std::array<double, 16> m{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    MTDB_RETURN_IF_ERROR(Numbers(node, "matrix", m));
    if (GltfMember(node, "matrix") != nullptr) {
      *placement = {
          {m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}, {m[12], m[13], m[14]}};
      return Status::Ok();
    }
    std::array<double, 4> t{0, 0, 0, 0}, s{1, 1, 1, 0}, q{0, 0, 0, 1};
    MTDB_RETURN_IF_ERROR(Numbers(node, "translation", std::span(t).first(3)));
    MTDB_RETURN_IF_ERROR(Numbers(node, "scale", std::span(s).first(3)));
    MTDB_RETURN_IF_ERROR(Numbers(node, "rotation", q));
    *placement = PlacementOf(t, q, s);
    return Status::Ok();
  }

  // A translation, a rotation as a quaternion, and a scale.
  static Placement PlacementOf(const std::array<double, 4>& t, const std::array<double, 4>& q,
                               const std::array<double, 4>& s) {
    const auto [x, y, z, w] = q;
    return {s[0] * Vec3d{1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)},
            s[1] * Vec3d{2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)},
            s[2] * Vec3d{2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)},
            {t[0], t[1], t[2]}};
  }

  // The nodes of the default scene; without scenes, all that are no children; without nodes, the
  // meshes as they are.
  Status PlaceNodes() {
    const GltfJson* const json = document_->json();
    const size_t nodes = GltfSize(json, "nodes");
    if (nodes == 0 && GltfSize(json, "scenes") == 0) {
      for (size_t m = 0; m < GltfSize(json, "meshes"); ++m) MTDB_RETURN_IF_ERROR(AddMesh(m, {}));
      return Status::Ok();
    }
    std::vector<std::pair<uint64_t, Placement>> open;
    uint64_t scene_number = 0;
    if (!GltfNumber(json, "scene", 0, &scene_number)) return Error("scene is no number");
    if (const GltfJson* scene = GltfElement(json, "scenes", scene_number); scene != nullptr) {
      MTDB_RETURN_IF_ERROR(AddNodes(scene, "nodes", {}, &open));
    } else {
      if (GltfMember(json, "scene") != nullptr) {
        report_->notes.push_back("there is no scene " + std::to_string(scene_number) +
                                 ": the nodes of all scenes are read");
      }
      std::set<uint64_t> children;
      for (size_t n = 0; n < nodes; ++n) {
        std::vector<std::pair<uint64_t, Placement>> list;
        MTDB_RETURN_IF_ERROR(AddNodes(GltfElement(json, "nodes", n), "children", {}, &list));
        for (const auto& [child, unused] : list) children.insert(child);
      }
      for (size_t n = 0; n < nodes; ++n) {
        if (!children.contains(n)) open.push_back({n, {}});
      }
    }
    // In the order of the file.
    std::ranges::reverse(open);
    other_scenes_ = GltfSize(json, "scenes") - (GltfSize(json, "scenes") > 0 ? 1 : 0);
    std::vector<bool> met(nodes, false);
    while (!open.empty()) {
      const auto [number, outer] = open.back();
      open.pop_back();
      const GltfJson* const node = GltfElement(json, "nodes", number);
      if (node == nullptr) return Error("no node " + std::to_string(number));
      if (met[number]) return Error("node " + std::to_string(number) + " is there twice");
      met[number] = true;
      Placement own;
      MTDB_RETURN_IF_ERROR(PlacementOf(node, &own));
      const Placement placement = outer * own;
      uint64_t mesh = 0;
      if (!GltfNumber(node, "mesh", kNone, &mesh)) return Error("a node's mesh is no number");
      if (mesh != kNone) MTDB_RETURN_IF_ERROR(AddInstances(node, mesh, placement));
      std::vector<std::pair<uint64_t, Placement>> children;
      MTDB_RETURN_IF_ERROR(AddNodes(node, "children", placement, &children));
      open.insert(open.end(), children.rbegin(), children.rend());
    }
    CountUnusedMeshes(nodes);
    for (size_t n = 0; n < nodes; ++n) {
      outside_ += !met[n] && GltfMember(GltfElement(json, "nodes", n), "mesh") != nullptr;
    }
    return Status::Ok();
  }

  // A mesh where a node puts it: once, or as often as EXT_mesh_gpu_instancing says.
  Status AddInstances(const GltfJson* node, uint64_t mesh, const Placement& placement) {
    const GltfJson* const attributes = GltfMember(
        GltfMember(GltfMember(node, "extensions"), "EXT_mesh_gpu_instancing"), "attributes");
    if (attributes == nullptr) return AddMesh(mesh, placement);
    constexpr std::array<const char*, 3> kNames{"TRANSLATION", "ROTATION", "SCALE"};
    std::array<std::optional<GltfValues>, 3> values;
    std::optional<uint64_t> count;
    for (size_t i = 0; i < kNames.size(); ++i) {
      uint64_t index = 0;
      if (!GltfNumber(attributes, kNames[i], kNone, &index)) return Error("an instance's number");
      if (index == kNone) continue;
      MTDB_ASSIGN_OR_RETURN(GltfAccessor accessor, document_->Accessor(index));
      if (accessor.components != (i == 1 ? 4 : 3) ||
          accessor.count != count.value_or(accessor.count)) {
        return Error(std::string("instances: ") + kNames[i] + " has another count or type");
      }
      count = accessor.count;
      values[i].emplace(std::move(accessor));
    }
    if (!count) return AddMesh(mesh, placement);
    for (uint64_t n = 0; n < *count; ++n) {
      std::array<double, 4> t{}, q{0, 0, 0, 1}, s{1, 1, 1, 0};
      if (values[0]) MTDB_RETURN_IF_ERROR(values[0]->Next(&t));
      if (values[1]) MTDB_RETURN_IF_ERROR(values[1]->Next(&q));
      if (values[2]) MTDB_RETURN_IF_ERROR(values[2]->Next(&s));
      MTDB_RETURN_IF_ERROR(AddMesh(mesh, placement * PlacementOf(t, q, s)));
    }
    return Status::Ok();
  }

  Status AddNodes(const GltfJson* json, const char* list, const Placement& placement,
                  std::vector<std::pair<uint64_t, Placement>>* nodes) const {
    for (size_t i = 0; i < GltfSize(json, list); ++i) {
      const GltfJson& number = *GltfElement(json, list, i);
      if (!number.is_number_unsigned()) return Error(std::string(list) + " is no list of numbers");
      nodes->push_back({number.get<uint64_t>(), placement});
    }
    return Status::Ok();
  }

  Status AddMesh(uint64_t mesh, const Placement& placement) {
    auto known = meshes_.find(mesh);
    if (known == meshes_.end()) {
      const uint64_t first = primitives_.size();
      MTDB_RETURN_IF_ERROR(AddPrimitives(mesh));
      known = meshes_.emplace(mesh, std::pair(first, uint64_t{primitives_.size()})).first;
    }
    const auto [first, end] = known->second;
    if (end - first > kMostPlaced - placed_.size()) {
      return Unsupported(document_->path() + ": glTF: its nodes place more than " +
                         std::to_string(kMostPlaced) +
                         " primitives; join some, or export the scene in parts");
    }
    for (uint64_t p = first; p < end; ++p) {
      ++primitives_[p].uses;
      primitives_[p].is_moved |= placement != Placement{};
      placed_.push_back({p, placement});
    }
    return Status::Ok();
  }

  // Of a mesh that is met for the first time.
  Status AddPrimitives(uint64_t mesh) {
    const GltfJson* const json = GltfElement(document_->json(), "meshes", mesh);
    if (json == nullptr) return Error("no mesh " + std::to_string(mesh));
    for (size_t p = 0; p < GltfSize(json, "primitives"); ++p) {
      const GltfJson* const primitive = GltfElement(json, "primitives", p);
      uint64_t mode = 0;
      if (!GltfNumber(primitive, "mode", kTriangles, &mode) || mode > kFan) {
        return Error("a primitive's mode is none");
      }
      if (mode < kTriangles) {
        ++lines_;
        continue;
      }
      morphs_ += GltfSize(primitive, "targets") != 0;
      const std::string where = "mesh " + std::to_string(mesh) + ", primitive " + std::to_string(p);
      primitives_.push_back({primitive, where, 0, false, {}});
    }
    return Status::Ok();
  }

  Result<GltfAccessor> AccessorOf(const Primitive& primitive, const char* name) const {
    uint64_t index = 0;
    if (!GltfNumber(GltfMember(primitive.json, "attributes"), name, kNone, &index) ||
        index == kNone) {
      return Error(primitive.where + " has no " + name);
    }
    return document_->Accessor(index);
  }
  static const GltfJson* DracoOf(const Primitive& primitive) {
    return GltfMember(GltfMember(primitive.json, "extensions"), "KHR_draco_mesh_compression");
  }
  // What the accessor says, without its bytes: where Draco has these, it names none.
  Result<GltfAccessor> ShapeOf(const Primitive& primitive, const char* name) const {
    if (DracoOf(primitive) == nullptr) return AccessorOf(primitive, name);
    uint64_t index = 0;
    if (!GltfNumber(GltfMember(primitive.json, "attributes"), name, kNone, &index)) {
      return Error(primitive.where + ": " + name + " is no number");
    }
    return document_->AccessorShape(index);
  }

  Status PlanTextures() {
    textures_.emplace(*document_, file_, report_);
    for (Primitive& primitive : primitives_) {
      MTDB_ASSIGN_OR_RETURN(primitive.texture, textures_->Add(primitive.json));
    }
    if (!textures_->Finish()) return Status::Ok();
    textures_->PutInto(&header_);
    for (Primitive& primitive : primitives_) {
      if (primitive.texture.page == TextureCorner::kNoPage) {
        primitive.texture.page = textures_->other_page();
      }
    }
    return Status::Ok();
  }

  // The header, and the columns that all primitives have.
  Status Plan() {
    if (primitives_.empty()) return Error("the scene has no triangles");
    MTDB_RETURN_IF_ERROR(PlanTextures());
    uint64_t vertices = 0;
    std::vector<std::string> names;  // of the first primitive; in the order of mtdb's writer
    std::set<std::string> custom;
    const GltfJson* const first = GltfMember(primitives_[0].json, "attributes");
    if (first == nullptr || !first->is_object()) return Error("a primitive has no attributes");
    for (const char* known : {"NORMAL", "COLOR_0"}) {
      if (GltfMember(first, known) != nullptr) names.emplace_back(known);
    }
    for (const auto& [name, unused] : first->items()) {
      if (name.starts_with("_")) names.push_back(name);
    }
    for (const Primitive& primitive : primitives_) {
      MTDB_ASSIGN_OR_RETURN(const GltfAccessor positions, ShapeOf(primitive, "POSITION"));
      if (positions.components != 3) return Error(primitive.where + ": POSITION is not VEC3");
      if (positions.count > kMostVertices) {
        return Error(primitive.where + ": " + std::to_string(positions.count) + " vertices");
      }
      vertices += primitive.uses * positions.count;
      header_.double_positions |=
          primitive.is_moved || positions.normalized || positions.type == ScalarType::kFloat64;
      const GltfJson* const attributes = GltfMember(primitive.json, "attributes");
      std::erase_if(names, [&](const std::string& name) {
        return GltfMember(attributes, name.c_str()) == nullptr;
      });
      for (const auto& [name, unused] : attributes->items()) {
        if (name.starts_with("TEXCOORD_") &&
            (!header_.textured || name != primitive.texture.coordinates)) {
          texture_coordinates_ += primitive.uses * positions.count;
        }
        if (name == "POSITION" || name.starts_with("TEXCOORD_")) continue;
        others_.insert(name);
      }
    }
    header_.vertex_count = vertices;
    for (const std::string& name : names) MTDB_RETURN_IF_ERROR(AddColumn(name));
    return Status::Ok();
  }

  Status AddColumn(const std::string& name) {
    int components = 4;
    ScalarType type = ScalarType::kFloat32;
    bool same = true;
    for (size_t i = 0; i < primitives_.size(); ++i) {
      MTDB_ASSIGN_OR_RETURN(const GltfAccessor a, ShapeOf(primitives_[i], name.c_str()));
      const ScalarType own = a.normalized ? ScalarType::kFloat32 : a.type;
      if (i > 0 && own != type) same = false;
      type = own;
      components = std::min(components, a.components);
    }
    auto& list = header_.attributes.attributes;
    if (name == "NORMAL" && components == 3) {
      for (const char* axis : {"nx", "ny", "nz"}) list.push_back({axis, ScalarType::kFloat32});
    } else if (name == "COLOR_0" && components >= 3) {
      const std::array<const char*, 4> parts{"red", "green", "blue", "alpha"};
      for (int c = 0; c < components; ++c) {
        list.push_back({parts[static_cast<size_t>(c)], ScalarType::kUint8});
      }
    } else if (name.starts_with("_") && name.size() > 1 && components == 1 && same) {
      std::string own = name.substr(1);
      for (char& c : own) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      if (list.size() >= kMaxAttributes) {
        return Error("more than " + std::to_string(kMaxAttributes) + " attributes");
      }
      const std::string usable = UsableAttributeName(own, header_.attributes);
      if (usable != own) {
        AddIgnored(report_, "the name of attribute " + Shown(name) + ", which is " + Shown(usable));
      }
      list.push_back({usable, type});
    } else {
      return Status::Ok();
    }
    columns_.push_back({name, components});
    others_.erase(name);
    return Status::Ok();
  }

  void CountUnusedMeshes(size_t nodes) {
    const GltfJson* const json = document_->json();
    std::set<uint64_t> named;
    for (size_t n = 0; n < nodes; ++n) {
      uint64_t mesh = kNone;
      if (GltfNumber(GltfElement(json, "nodes", n), "mesh", kNone, &mesh)) named.insert(mesh);
    }
    const size_t meshes = GltfSize(json, "meshes");
    unused_meshes_ =
        meshes - static_cast<size_t>(std::distance(named.begin(), named.lower_bound(meshes)));
  }

  void CountIgnored() {
    const auto count = [&](uint64_t number, const char* what) {
      if (number != 0) AddIgnored(report_, std::to_string(number) + " " + what);
    };
    const GltfJson* const json = document_->json();
    count(texture_coordinates_, "texture coordinates");
    count(GltfSize(json, "materials") - textures_->materials(), "materials");
    count(GltfSize(json, "images") - textures_->images(), "images");
    count(GltfSize(json, "skins"), "skins");
    count(GltfSize(json, "animations"), "animations");
    count(morphs_, "primitives' morph targets");
    count(lines_, "primitives of points or lines");
    count(other_scenes_, other_scenes_ == 1 ? "other scene" : "other scenes");
    count(outside_, outside_ == 1 ? "node outside of the scene with its mesh"
                                  : "nodes outside of the scene with their meshes");
    count(unused_meshes_,
          unused_meshes_ == 1 ? "mesh that no node has" : "meshes that no node has");
    for (const std::string& name : others_) AddIgnored(report_, "attribute " + Shown(name));
    for (size_t i = 0; i < GltfSize(json, "extensionsUsed"); ++i) {
      const GltfJson& name = *GltfElement(json, "extensionsUsed", i);
      if (!name.is_string() || GltfDocument::KnowsExtension(name.get<std::string>())) continue;
      AddIgnored(report_, "extension " + Shown(name.get<std::string>()));
    }
  }

  // The beginning of a name, on one line.
  static std::string Shown(const std::string& name) {
    constexpr size_t kMost = 60;
    return UsableAttributeName(name.substr(0, kMost), {});
  }

  Status Emit(const Primitive& primitive, const Placement& placement) {
    std::unique_ptr<DracoMesh> draco;
    if (const GltfJson* const extension = DracoOf(primitive); extension != nullptr) {
      MTDB_ASSIGN_OR_RETURN(draco, Decode(primitive, extension));
    }
    std::vector<Source> sources;
    MTDB_ASSIGN_OR_RETURN(const GltfAccessor positions, ShapeOf(primitive, "POSITION"));
    MTDB_ASSIGN_OR_RETURN(Source position, SourceOf(primitive, draco.get(), "POSITION"));
    for (const Column& column : columns_) {
      MTDB_ASSIGN_OR_RETURN(Source source, SourceOf(primitive, draco.get(), column.name.c_str()));
      if (source.values && source.values->accessor().count != positions.count) {
        return Error(primitive.where + ": " + column.name + " has another count than POSITION");
      }
      sources.push_back(std::move(source));
    }
    if (draco != nullptr && draco->points() != positions.count) {
      return Error(primitive.where + ": " + std::to_string(draco->points()) +
                   " vertices in Draco, but the accessor has " + std::to_string(positions.count));
    }
    std::optional<Source> texture;
    table_.Clear();
    if (header_.textured && !primitive.texture.coordinates.empty()) {
      MTDB_ASSIGN_OR_RETURN(texture, TextureSourceOf(primitive, draco.get(), positions.count));
    }
    Bytes row(header_.attributes.row_bytes());
    for (uint64_t v = 0; v < positions.count; ++v) {
      std::array<double, 4> value;
      if (texture) {
        MTDB_RETURN_IF_ERROR(ValueOf(*texture, v, &value));
        MTDB_RETURN_IF_ERROR(table_.Append(primitive.texture.Apply(value[0], value[1])));
      }
      MTDB_RETURN_IF_ERROR(ValueOf(position, v, &value));
      const Vec3d p = placement({value[0], value[1], value[2]});
      if (const std::string problem = CoordinateFault(p); !problem.empty()) {
        return BadInput(file_.path() + ": " + primitive.where + ", vertex " + std::to_string(v) +
                        ": " + problem);
      }
      MTDB_RETURN_IF_ERROR(PutRow(placement, sources, v, row.data()));
      MTDB_RETURN_IF_ERROR(emitter_.AddVertex(p, row));
    }
    MTDB_RETURN_IF_ERROR(
        EmitTriangles(primitive, placement.mirrors(), draco.get(), positions.count));
    first_ += positions.count;
    return Status::Ok();
  }

  Result<std::unique_ptr<DracoMesh>> Decode(const Primitive& primitive,
                                            const GltfJson* extension) const {
    uint64_t view = 0;
    if (!GltfNumber(extension, "bufferView", kNone, &view)) return Error("Draco: no bufferView");
    MTDB_ASSIGN_OR_RETURN(const GltfBytes part, document_->BufferView(view));
    MTDB_ASSIGN_OR_RETURN(const Bytes bytes, document_->Load(part));
    return DracoMesh::Decode(bytes, file_.path() + ": " + primitive.where);
  }

  Result<Source> SourceOf(const Primitive& primitive, const DracoMesh* draco,
                          const char* name) const {
    Source source;
    uint64_t id = kNone;
    if (draco != nullptr &&
        !GltfNumber(GltfMember(DracoOf(primitive), "attributes"), name, kNone, &id)) {
      return Error(primitive.where + ": Draco's " + name + " is no number");
    }
    if (id == kNone) {
      MTDB_ASSIGN_OR_RETURN(GltfAccessor accessor, AccessorOf(primitive, name));
      if (!accessor.normalized) source.colour_scale = 1 / WholeOf(accessor.type);
      source.values.emplace(std::move(accessor));
      return source;
    }
    MTDB_ASSIGN_OR_RETURN(const GltfAccessor shape, ShapeOf(primitive, name));
    for (const DracoAttribute& a : draco->attributes()) {
      if (a.unique_id != id) continue;
      source.draco = draco;
      source.attribute = a.index;
      (shape.normalized ? source.scale : source.colour_scale) = 1 / WholeOf(a.type);
      return source;
    }
    return Error(primitive.where + ": Draco has no attribute " + std::to_string(id));
  }

  Result<Source> TextureSourceOf(const Primitive& primitive, const DracoMesh* draco,
                                 uint64_t vertices) const {
    const char* const name = primitive.texture.coordinates.c_str();
    MTDB_ASSIGN_OR_RETURN(Source source, SourceOf(primitive, draco, name));
    if (source.values && source.values->accessor().count != vertices) {
      return Error(primitive.where + ": " + name + " has another count than POSITION");
    }
    return source;
  }

  static Status ValueOf(Source& source, uint64_t vertex, std::array<double, 4>* value) {
    if (source.values) return source.values->Next(value);
    *value = source.draco->Value(source.attribute, static_cast<uint32_t>(vertex));
    for (double& v : *value) v *= source.scale;
    return Status::Ok();
  }

  Status PutRow(const Placement& placement, std::vector<Source>& sources, uint64_t vertex,
                std::byte* at) {
    size_t attribute = 0;
    for (size_t c = 0; c < columns_.size(); ++c) {
      std::array<double, 4> value;
      MTDB_RETURN_IF_ERROR(ValueOf(sources[c], vertex, &value));
      if (columns_[c].name == "NORMAL") {
        const Vec3d n{value[0], value[1], value[2]};
        if (placement != Placement{}) {
          const Vec3d turned = placement.Normal(n);
          value = {turned.x, turned.y, turned.z, 0};
        }
      } else if (columns_[c].name == "COLOR_0") {
        // They are linear, and sRGB in mtdb, as in all other formats; alpha is what it is.
        for (size_t i = 0; i < value.size(); ++i) {
          const double part = std::clamp(value[i] * sources[c].colour_scale, 0.0, 1.0);
          value[i] = 255 * (i < 3 ? SrgbOfLinear(part) : part);
        }
      }
      for (int i = 0; i < columns_[c].components; ++i) {
        at = PutScalar(value[static_cast<size_t>(i)],
                       header_.attributes.attributes[attribute++].type, at);
      }
    }
    return Status::Ok();
  }

  // Vertices are those of the primitive.
  Status AddTriangle(const Primitive& primitive, const TriangleVertices& t) {
    if (table_.size() == 0)
      return emitter_.AddTriangle(first_ + t[0], first_ + t[1], first_ + t[2]);
    std::array<TextureCorner, 3> corners;
    for (size_t i = 0; i < 3; ++i) {
      TexturePlace place;
      MTDB_RETURN_IF_ERROR(table_.Get(t[i], &place));
      corners[i] = {place.u, place.v, primitive.texture.page};
    }
    return emitter_.AddTriangle(first_ + t[0], first_ + t[1], first_ + t[2], corners);
  }

  Status EmitTriangles(const Primitive& primitive, bool mirrors, const DracoMesh* draco,
                       uint64_t vertices) {
    const auto add = [&](uint64_t a, uint64_t b, uint64_t c) {
      if (const uint64_t most = std::max({a, b, c}); most >= vertices) {
        return BadInput(file_.path() + ": " + primitive.where + ": vertex index " +
                        std::to_string(most) + ", but the primitive has " +
                        std::to_string(vertices) + " vertices");
      }
      if (mirrors) std::swap(b, c);
      return AddTriangle(primitive, {a, b, c});
    };
    if (draco != nullptr) {
      for (uint32_t t = 0; t < draco->triangles(); ++t) {
        const TriangleVertices corners = draco->triangle(t);
        MTDB_RETURN_IF_ERROR(add(corners[0], corners[1], corners[2]));
      }
      return Status::Ok();
    }
    uint64_t mode = 0, index = 0;
    if (!GltfNumber(primitive.json, "mode", kTriangles, &mode) ||
        !GltfNumber(primitive.json, "indices", kNone, &index)) {
      return Error(primitive.where + ": indices is no number");
    }
    std::optional<GltfValues> indices;
    uint64_t count = vertices;
    if (index != kNone) {
      MTDB_ASSIGN_OR_RETURN(GltfAccessor accessor, document_->Accessor(index));
      if (accessor.components != 1 || accessor.type >= ScalarType::kFloat32) {
        return Error(primitive.where + ": its indices are no whole numbers");
      }
      accessor.normalized = false;
      count = accessor.count;
      indices.emplace(std::move(accessor));
    }
    if (mode == kTriangles && count % 3 != 0) {
      AddIgnored(report_, primitive.where + ": " + std::to_string(count % 3) +
                              (count % 3 == 1 ? " corner" : " corners") +
                              " behind the last triangle");
    }
    uint64_t a = 0, b = 0;
    for (uint64_t i = 0; i < count; ++i) {
      uint64_t c = i;
      if (indices) {
        std::array<double, 4> value;
        MTDB_RETURN_IF_ERROR(indices->Next(&value));
        if (value[0] < 0) return Error(primitive.where + ": an index below 0");
        c = static_cast<uint64_t>(value[0]);
      }
      const bool whole = mode == kTriangles ? i % 3 == 2 : i >= 2;
      if (whole) {
        const bool odd = mode == kStrip && i % 2 == 1;
        MTDB_RETURN_IF_ERROR(odd ? add(b, a, c) : add(a, b, c));
      }
      // A fan keeps its first corner.
      if (mode != kFan || i == 0) a = i == 0 || mode == kFan ? c : b;
      b = c;
    }
    return Status::Ok();
  }

  const InputFile& file_;
  MeshEmitter emitter_;
  MeshReadReport* report_;
  std::unique_ptr<GltfDocument> document_;
  std::vector<Primitive> primitives_;                         // each once
  std::map<uint64_t, std::pair<uint64_t, uint64_t>> meshes_;  // their first primitives and ends
  std::vector<Placed> placed_;                                // in the order of the scene
  MeshHeader header_;
  std::vector<Column> columns_;
  std::set<std::string> others_;  // attributes that are not carried
  std::optional<GltfTextures> textures_;
  CornerTable table_;                 // of the primitive's vertices; empty: it has no coordinates
  uint64_t texture_coordinates_ = 0;  // that are not carried
  uint64_t lines_ = 0;
  uint64_t morphs_ = 0;
  uint64_t other_scenes_ = 0;
  uint64_t unused_meshes_ = 0;
  uint64_t outside_ = 0;   // nodes with meshes that the scene does not have
  VertexIndex first_ = 0;  // of the primitive
};

}  // namespace

MeshFileFit RecogniseGltf(const MeshFileStart& start) {
  return start.bytes.starts_with("glTF") ? MeshFileFit::kContent : MeshFileFit::kNone;
}

MeshFileFit RecogniseGltfJson(const MeshFileStart& start) {
  const size_t first = start.text.find_first_not_of(" \t\r\n");
  const bool is_object = first != std::string_view::npos && start.text[first] == '{';
  return is_object && start.named ? MeshFileFit::kContent : MeshFileFit::kNone;
}

Status ReadGltf(const InputFile& file, const MeshFileStart& start, MeshSink& sink,
                MeshReadReport* report) {
  return GltfReader(file, start.tmp, sink, report).Read();
}

}  // namespace mtdb::internal
