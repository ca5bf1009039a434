// SPDX-License-Identifier: Apache-2.0
#include "codecs/mesh_file/readers/gltf_document.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <meshoptimizer.h>
#include <set>
#include <utility>

#include "store/base/json_depth.h"

namespace mtdb::internal {

namespace {

constexpr uint64_t kMaxJsonBytes = uint64_t{16} << 20;
constexpr int kMaxDepth = 64;
constexpr uint32_t kJsonChunk = 0x4e4f534a;
constexpr uint32_t kBinaryChunk = 0x004e4942;
constexpr uint64_t kHeaderBytes = 12;
constexpr uint64_t kChunkHeaderBytes = 8;
constexpr uint64_t kMaxNumber = uint64_t{1} << 53;
// What meshoptimizer's formats can make of a byte at most, and a little.
constexpr uint64_t kMostPerByte = 64;

uint32_t Word(const std::byte* bytes) {
  uint32_t word = 0;
  std::memcpy(&word, bytes, sizeof(word));
  return word;
}

bool TypeOf(uint64_t component, ScalarType* type) {
  switch (component) {
    case 5120: *type = ScalarType::kInt8; return true;
    case 5121: *type = ScalarType::kUint8; return true;
    case 5122: *type = ScalarType::kInt16; return true;
    case 5123: *type = ScalarType::kUint16; return true;
    case 5125: *type = ScalarType::kUint32; return true;
    case 5126: *type = ScalarType::kFloat32; return true;
    case 5130: *type = ScalarType::kFloat64; return true;  // KHR_accessor_float64
    default: return false;
  }
}

int ComponentsOf(const GltfJson* type) {
  if (type == nullptr || !type->is_string()) return 0;
  const std::string& name = type->get_ref<const std::string&>();
  if (name == "SCALAR") return 1;
  if (name.size() == 4 && name.starts_with("VEC") && name[3] >= '2' && name[3] <= '4') {
    return name[3] - '0';
  }
  return 0;
}

bool DecodeBase64(std::string_view text, Bytes* bytes) {
  uint32_t bits = 0;
  int count = 0;
  for (const char c : text) {
    int value = 0;
    if (c >= 'A' && c <= 'Z') {
      value = c - 'A';
    } else if (c >= 'a' && c <= 'z') {
      value = c - 'a' + 26;
    } else if (c >= '0' && c <= '9') {
      value = c - '0' + 52;
    } else if (c == '+' || c == '-') {
      value = 62;
    } else if (c == '/' || c == '_') {
      value = 63;
    } else if (c == '=') {
      break;
    } else {
      return false;
    }
    bits = bits << 6 | static_cast<uint32_t>(value);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    bytes->push_back(static_cast<std::byte>(bits >> count & 0xff));
  }
  return true;
}

// meshopt's filter of colours: luma, two differences, and an alpha whose highest bit tells how many
// bits the four have; back to red, green, blue and alpha that fill theirs.
template <typename Value, typename Difference>
void DecodeColours(Bytes& bytes) {
  for (size_t at = 0; at + 4 * sizeof(Value) <= bytes.size(); at += 4 * sizeof(Value)) {
    std::array<Value, 4> coded;
    std::memcpy(coded.data(), bytes.data() + at, sizeof(coded));
    const int luma = coded[0];
    const int orange = static_cast<Difference>(coded[1]);
    const int green = static_cast<Difference>(coded[2]);
    const auto full = static_cast<int>(std::bit_ceil(uint32_t{coded[3]} + 1) - 1);
    const int alpha = ((coded[3] << 1) & full) | (coded[3] & 1);
    const std::array<int, 4> parts{luma + orange - green, luma + green, luma - orange - green,
                                   alpha};
    constexpr double kMost = std::numeric_limits<Value>::max();
    for (size_t i = 0; i < 4; ++i) {
      const double part = full == 0 ? 0 : kMost * parts[i] / full;
      coded[i] = static_cast<Value>(std::clamp(std::floor(part + 0.5), 0.0, kMost));
    }
    std::memcpy(bytes.data() + at, coded.data(), sizeof(coded));
  }
}

// Undoes meshopt's filter of that name; false when there is none, or not for such elements.
bool Unfilter(const std::string& name, uint64_t count, uint64_t stride, Bytes& bytes) {
  if (name == "OCTAHEDRAL" && (stride == 4 || stride == 8)) {
    meshopt_decodeFilterOct(bytes.data(), count, stride);
  } else if (name == "QUATERNION" && stride == 8) {
    meshopt_decodeFilterQuat(bytes.data(), count, stride);
  } else if (name == "EXPONENTIAL") {
    meshopt_decodeFilterExp(bytes.data(), count, stride);
  } else if (name == "COLOR" && stride == 4) {
    DecodeColours<uint8_t, int8_t>(bytes);
  } else if (name == "COLOR" && stride == 8) {
    DecodeColours<uint16_t, int16_t>(bytes);
  } else {
    return name == "NONE";
  }
  return true;
}

}  // namespace

const GltfJson* GltfMember(const GltfJson* json, const char* key) {
  if (json == nullptr || !json->is_object()) return nullptr;
  const auto at = json->find(key);
  return at == json->end() ? nullptr : &*at;
}

const GltfJson* GltfElement(const GltfJson* json, const char* list, uint64_t index) {
  const GltfJson* const array = GltfMember(json, list);
  return array == nullptr || !array->is_array() || index >= array->size() ? nullptr
                                                                          : &(*array)[index];
}

size_t GltfSize(const GltfJson* json, const char* list) {
  const GltfJson* const array = GltfMember(json, list);
  return array == nullptr || !array->is_array() ? 0 : array->size();
}

bool GltfNumber(const GltfJson* json, const char* key, uint64_t otherwise, uint64_t* value) {
  const GltfJson* const number = GltfMember(json, key);
  *value = otherwise;
  if (number == nullptr) return true;
  if (number->is_number_float()) {
    // Some programs write 12.0.
    const double real = number->get<double>();
    if (!(real >= 0) || real > static_cast<double>(kMaxNumber)) return false;
    *value = static_cast<uint64_t>(real);
    return static_cast<double>(*value) == real;
  }
  if (!number->is_number_unsigned()) return false;
  *value = number->get<uint64_t>();
  return *value <= kMaxNumber;
}

Result<std::unique_ptr<GltfDocument>> GltfDocument::Open(const InputFile& file) {
  std::unique_ptr<GltfDocument> document(new GltfDocument());
  document->path_ = file.path();
  document->file_bytes_ = file.size_bytes();
  MTDB_RETURN_IF_ERROR(document->ReadJson(file));
  MTDB_RETURN_IF_ERROR(document->CheckExtensions());
  return document;
}

Status GltfDocument::ReadJson(const InputFile& file) {
  uint64_t begin = 0, size = file.size_bytes();
  std::array<std::byte, kHeaderBytes + kChunkHeaderBytes> header;
  MTDB_ASSIGN_OR_RETURN(const size_t read, file.ReadAt(0, header));
  const bool is_binary = AsString(header).starts_with("glTF");
  if (is_binary) {
    if (read < header.size()) return Error("the file is cut short in its header");
    if (Word(header.data() + 4) != 2) {
      return Unsupported(path_ + ": glTF: version " + std::to_string(Word(header.data() + 4)) +
                         ", expected 2");
    }
    begin = header.size();
    size = Word(header.data() + 12);
    if (Word(header.data() + 16) != kJsonChunk) return Error("the first chunk is not JSON");
    if (size > file.size_bytes() - begin) {
      return Error("a JSON chunk of " + std::to_string(size) + " bytes, but only " +
                   std::to_string(file.size_bytes() - begin) + " follow; the file is cut short");
    }
  }
  if (size > kMaxJsonBytes) {
    return Unsupported(path_ + ": glTF: " + std::to_string(size) + " bytes of JSON, at most " +
                       std::to_string(kMaxJsonBytes) +
                       " are read; where they hold the mesh itself, convert it to .glb");
  }
  Bytes text(size);
  MTDB_ASSIGN_OR_RETURN(const size_t got, file.ReadAt(begin, text));
  if (got < size || TooDeepAt(AsString(text), kMaxDepth) != std::string_view::npos)
    return Error("the JSON is damaged");
  json_ = GltfJson::parse(AsString(text), nullptr, false);
  if (json_.is_discarded() || !json_.is_object()) return Error("the JSON is damaged");
  if (!is_binary) return Status::Ok();
  return FindBinaryChunk(file, begin + (size + 3) / 4 * 4);
}

// It should be the second. Programs that put others in front of it are read all the same, and what
// is behind it is left alone.
Status GltfDocument::FindBinaryChunk(const InputFile& file, uint64_t chunk) {
  constexpr int kMostChunks = 64;
  for (int i = 0; i < kMostChunks; ++i) {
    std::array<std::byte, kChunkHeaderBytes> header;
    MTDB_ASSIGN_OR_RETURN(const size_t read, file.ReadAt(chunk, header));
    if (read < header.size()) return Status::Ok();
    const uint64_t size = Word(header.data());
    if (Word(header.data() + 4) == kBinaryChunk) {
      // The reader's file outlives the document.
      binary_.file = std::shared_ptr<const InputFile>(std::shared_ptr<const InputFile>(), &file);
      binary_.begin = chunk + header.size();
      binary_.size = std::min<uint64_t>(size, file.size_bytes() - binary_.begin);
      return Status::Ok();
    }
    chunk += header.size() + (size + 3) / 4 * 4;
  }
  return Status::Ok();
}

bool GltfDocument::KnowsExtension(const std::string& name) {
  static const std::set<std::string> kKnown{
      // Read.
      "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression",
      "KHR_mesh_quantization", "KHR_accessor_float64", "EXT_mesh_gpu_instancing",
      // Of what is not carried: lights, sounds, physics, scripts, and what is known of things.
      "KHR_xmp", "KHR_xmp_json_ld", "KHR_interactivity", "KHR_audio", "KHR_audio_emitter",
      "KHR_audio_graph", "KHR_techniques_webgl", "KHR_physics_rigid_bodies", "KHR_implicit_shapes",
      "KHR_blend", "KHR_environment_map", "KHR_camera_perspective", "EXT_structural_metadata",
      "EXT_mesh_features", "EXT_instance_features", "EXT_feature_metadata",
      "EXT_mesh_primitive_edge_visibility", "EXT_property_animation", "CESIUM_primitive_outline",
      "AGI_articulations", "AGI_stk_metadata", "FB_geometry_metadata", "FB_ngon_encoding",
      "GRIFFEL_bim_data", "MSFT_audio_emitter", "NV_materials_mdl", "OMI_physics_body",
      "OMI_physics_joint", "OMI_physics_shape", "OMI_collider", "OMI_spawn_point", "OMI_seat",
      "OMI_link", "VRM"};
  static constexpr std::array<std::string_view, 14> kKinds{
      "KHR_materials_", "EXT_materials_", "ADOBE_materials_", "MSFT_packing_",
      "KHR_texture_",   "EXT_texture_",   "MSFT_texture_",    "KHR_lights_",
      "EXT_lights_",    "KHR_animation_", "KHR_node_",        "KHR_xmp_",
      "VRMC_",          "OMI_audio_"};
  return kKnown.contains(name) ||
         std::ranges::any_of(kKinds, [&](std::string_view kind) { return name.starts_with(kind); });
}

Status GltfDocument::CheckExtensions() const {
  for (size_t i = 0; i < GltfSize(&json_, "extensionsRequired"); ++i) {
    const GltfJson& name = *GltfElement(&json_, "extensionsRequired", i);
    if (!name.is_string()) return Error("extensionsRequired is not a list of names");
    const auto& text = name.get_ref<const std::string&>();
    if (KnowsExtension(text)) continue;
    return Unsupported(path_ + ": glTF: the file needs the extension " + text.substr(0, 100) +
                       ", which mtdb does not read; export it without");
  }
  return Status::Ok();
}

std::string GltfDocument::Unescaped(const std::string& uri) {
  std::string text;
  for (size_t i = 0; i < uri.size(); ++i) {
    const auto digit = [&](size_t at) {
      const char c = at < uri.size() ? uri[at] : ' ';
      return c >= '0' && c <= '9'   ? c - '0'
             : c >= 'a' && c <= 'f' ? c - 'a' + 10
             : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                    : -1;
    };
    if (uri[i] == '%' && digit(i + 1) >= 0 && digit(i + 2) >= 0) {
      text += static_cast<char>(16 * digit(i + 1) + digit(i + 2));
      i += 2;
    } else {
      text += uri[i];
    }
  }
  return text;
}

Result<GltfBytes> GltfDocument::DataUri(const std::string& text) const {
  const size_t comma = text.find(',');
  if (comma == std::string::npos || text.find(";base64") > comma) {
    return Error("a data URI is not base64");
  }
  auto bytes = std::make_shared<Bytes>();
  if (!DecodeBase64(std::string_view(text).substr(comma + 1), bytes.get())) {
    return Error("a data URI is not base64");
  }
  GltfBytes part;
  part.size = bytes->size();
  part.memory = std::move(bytes);
  return part;
}

Result<GltfBytes> GltfDocument::Buffer(uint64_t index) const {
  const GltfJson* const buffer = GltfElement(&json_, "buffers", index);
  if (buffer == nullptr) return Error("no buffer " + std::to_string(index));
  const GltfJson* const uri = GltfMember(buffer, "uri");
  if (uri == nullptr) {
    if (index != 0 || binary_.file == nullptr) {
      return Error("buffer " + std::to_string(index) +
                   " has neither a file nor a chunk of type BIN");
    }
    return binary_;
  }
  if (!uri->is_string()) return Error("a buffer's uri is no text");
  const auto& text = uri->get_ref<const std::string&>();
  if (text.starts_with("data:")) {
    if (const auto known = data_uris_.find(index); known != data_uris_.end()) return known->second;
    MTDB_ASSIGN_OR_RETURN(GltfBytes bytes, DataUri(text));
    return data_uris_.emplace(index, std::move(bytes)).first->second;
  }
  if (text.empty()) return Error("buffer " + std::to_string(index) + " names no file");
  const std::filesystem::path name(Unescaped(text));
  // A file that came from elsewhere must not make others of this machine part of a mesh.
  const bool inside =
      name.is_relative() && text.find(':') == std::string::npos &&
      std::none_of(name.begin(), name.end(), [](const auto& part) { return part == ".."; });
  if (!inside) {
    return Error("buffer " + std::to_string(index) +
                 " is in a file outside of this one's folder; copy it there, or convert to .glb");
  }
  const std::string path = (std::filesystem::path(path_).parent_path() / name).string();
  Result<std::unique_ptr<InputFile>> file = InputFile::Open(path);
  if (!file.ok()) {
    return Status(file.status().code(), path_ + ": glTF: buffer " + std::to_string(index) + ": " +
                                            file.status().message() +
                                            "; put the file there, or convert to .glb");
  }
  GltfBytes bytes;
  bytes.size = (*file)->size_bytes();
  bytes.file = *std::move(file);
  return bytes;
}

Result<GltfBytes> GltfDocument::Part(uint64_t buffer, uint64_t offset, uint64_t size) const {
  MTDB_ASSIGN_OR_RETURN(GltfBytes bytes, Buffer(buffer));
  if (offset > bytes.size || size > bytes.size - offset) {
    return Error("bytes " + std::to_string(offset) + " to " + std::to_string(offset + size) +
                 " of buffer " + std::to_string(buffer) + ", which has " +
                 std::to_string(bytes.size) + "; the file is cut short");
  }
  bytes.begin += offset;
  bytes.size = size;
  return bytes;
}

Result<GltfBytes> GltfDocument::BufferView(uint64_t index) const {
  const GltfJson* const view = GltfElement(&json_, "bufferViews", index);
  if (view == nullptr) return Error("no bufferView " + std::to_string(index));
  const GltfJson* const extensions = GltfMember(view, "extensions");
  const GltfJson* meshopt = GltfMember(extensions, "EXT_meshopt_compression");
  if (meshopt == nullptr) meshopt = GltfMember(extensions, "KHR_meshopt_compression");
  if (meshopt != nullptr) {
    const auto known =
        std::ranges::find(decompressed_, index, [](const auto& kept) { return kept.first; });
    if (known != decompressed_.end()) return known->second;
    MTDB_ASSIGN_OR_RETURN(GltfBytes bytes, Decompressed(meshopt));
    if (decompressed_.size() == kKeptViews) decompressed_.erase(decompressed_.begin());
    return decompressed_.emplace_back(index, std::move(bytes)).second;
  }
  uint64_t buffer = 0, offset = 0, size = 0, stride = 0;
  if (!GltfNumber(view, "buffer", kMaxNumber, &buffer) ||
      !GltfNumber(view, "byteOffset", 0, &offset) || !GltfNumber(view, "byteLength", 0, &size) ||
      !GltfNumber(view, "byteStride", 0, &stride) || stride > 65536) {
    return Error("bufferView " + std::to_string(index) + " has a wrong number");
  }
  MTDB_ASSIGN_OR_RETURN(GltfBytes bytes, Part(buffer, offset, size));
  bytes.stride = stride;
  return bytes;
}

Result<GltfBytes> GltfDocument::Decompressed(const GltfJson* extension) const {
  uint64_t buffer = 0, offset = 0, size = 0, stride = 0, count = 0;
  const GltfJson* const mode = GltfMember(extension, "mode");
  const GltfJson* const filter = GltfMember(extension, "filter");
  if (!GltfNumber(extension, "buffer", kMaxNumber, &buffer) ||
      !GltfNumber(extension, "byteOffset", 0, &offset) ||
      !GltfNumber(extension, "byteLength", 0, &size) ||
      !GltfNumber(extension, "byteStride", 0, &stride) ||
      !GltfNumber(extension, "count", 0, &count) || mode == nullptr || !mode->is_string() ||
      (filter != nullptr && !filter->is_string())) {
    return Error("meshopt compression has a wrong member");
  }
  const std::string kind = mode->get<std::string>();
  const std::string how = filter == nullptr ? "NONE" : filter->get<std::string>();
  const bool is_index = kind == "TRIANGLES" || kind == "INDICES";
  if (is_index ? (stride != 2 && stride != 4) || (kind == "TRIANGLES" && count % 3 != 0)
               : kind != "ATTRIBUTES" || stride == 0 || stride > 256 || stride % 4 != 0) {
    return Error("meshopt compression of mode " + kind.substr(0, 20) + " and " +
                 std::to_string(stride) + " bytes an element");
  }
  MTDB_ASSIGN_OR_RETURN(const GltfBytes part, Part(buffer, offset, size));
  if (count > (kMostPerByte * size + 4096) / stride) {
    return Error(std::to_string(size) + " bytes of meshopt promise " + std::to_string(count) +
                 " elements; the file is damaged");
  }
  MTDB_ASSIGN_OR_RETURN(const Bytes packed, Load(part));
  auto bytes = std::make_shared<Bytes>(count * stride);
  const auto* source = reinterpret_cast<const unsigned char*>(packed.data());
  const int code =
      kind == "ATTRIBUTES"
          ? meshopt_decodeVertexBuffer(bytes->data(), count, stride, source, packed.size())
      : kind == "TRIANGLES"
          ? meshopt_decodeIndexBuffer(bytes->data(), count, stride, source, packed.size())
          : meshopt_decodeIndexSequence(bytes->data(), count, stride, source, packed.size());
  if (code != 0) {
    // The first byte of vertices has their format's version.
    if (kind == "ATTRIBUTES" && !packed.empty() && packed[0] == std::byte{0xa1}) {
      return Unsupported(path_ +
                         ": glTF: vertices in version 1 of meshopt's format, mtdb reads version 0; "
                         "export it with EXT_meshopt_compression");
    }
    return Error("meshopt cannot decode a bufferView; the file is damaged");
  }
  if (!Unfilter(how, count, stride, *bytes)) {
    return Error("meshopt filter " + how.substr(0, 20) + " of " + std::to_string(stride) +
                 " bytes an element");
  }
  GltfBytes result;
  result.size = bytes->size();
  result.stride = stride;
  result.memory = std::move(bytes);
  return result;
}

Result<Bytes> GltfDocument::Load(const GltfBytes& bytes) const {
  Bytes all(bytes.size);
  if (bytes.memory != nullptr) {
    std::copy_n(bytes.memory->data() + bytes.begin, bytes.size, all.data());
    return all;
  }
  MTDB_ASSIGN_OR_RETURN(const size_t read, bytes.file->ReadAt(bytes.begin, all));
  if (read < all.size()) return Error("a buffer is cut short");
  return all;
}

Result<GltfAccessor> GltfDocument::AccessorShape(uint64_t index) const {
  const std::string name = "accessor " + std::to_string(index);
  const GltfJson* const json = GltfElement(&json_, "accessors", index);
  if (json == nullptr) return Error("no " + name);
  GltfAccessor accessor;
  uint64_t component = 0;
  if (!GltfNumber(json, "componentType", 0, &component) ||
      !GltfNumber(json, "count", 0, &accessor.count)) {
    return Error(name + " has a wrong number");
  }
  accessor.components = ComponentsOf(GltfMember(json, "type"));
  if (accessor.components == 0 || !TypeOf(component, &accessor.type)) {
    return Error(name + " is of an unknown type");
  }
  const GltfJson* const normalized = GltfMember(json, "normalized");
  accessor.normalized =
      normalized != nullptr && normalized->is_boolean() && normalized->get<bool>();
  return accessor;
}

Result<GltfAccessor> GltfDocument::Accessor(uint64_t index) const {
  MTDB_ASSIGN_OR_RETURN(GltfAccessor accessor, AccessorShape(index));
  const std::string name = "accessor " + std::to_string(index);
  const GltfJson* const json = GltfElement(&json_, "accessors", index);
  uint64_t view = 0, offset = 0;
  if (!GltfNumber(json, "bufferView", kMaxNumber, &view) ||
      !GltfNumber(json, "byteOffset", 0, &offset)) {
    return Error(name + " has a wrong number");
  }
  const uint64_t value_bytes =
      ScalarSize(accessor.type) * static_cast<uint64_t>(accessor.components);
  MTDB_RETURN_IF_ERROR(ReadSparse(json, name, &accessor));
  if (GltfMember(json, "bufferView") == nullptr) {
    // All its values are 0. Others of the same count have bytes, or the file is a trap.
    if (accessor.count > kMostPerByte * file_bytes_) {
      return Error(name + " has " + std::to_string(accessor.count) +
                   " values without a bufferView; the file is damaged");
    }
    accessor.bytes.stride = value_bytes;
    accessor.bytes.size = accessor.count * value_bytes;
    return accessor;
  }
  MTDB_ASSIGN_OR_RETURN(accessor.bytes, BufferView(view));
  GltfBytes& bytes = accessor.bytes;
  if (bytes.stride == 0) bytes.stride = value_bytes;
  const uint64_t room = offset > bytes.size ? 0 : bytes.size - offset;
  const bool fits =
      accessor.count == 0 || (bytes.stride >= value_bytes && room >= value_bytes &&
                              (room - value_bytes) / bytes.stride + 1 >= accessor.count);
  if (!fits) {
    return Error(name + ": " + std::to_string(accessor.count) + " values of " +
                 std::to_string(value_bytes) + " bytes, but its bufferView has " +
                 std::to_string(bytes.size) + " bytes; the file is cut short");
  }
  bytes.begin += offset;
  bytes.size = room;
  return accessor;
}

Status GltfDocument::ReadSparse(const GltfJson* json, const std::string& name,
                                GltfAccessor* accessor) const {
  const GltfJson* const sparse = GltfMember(json, "sparse");
  if (sparse == nullptr) return Status::Ok();
  const GltfJson* const indices = GltfMember(sparse, "indices");
  const GltfJson* const values = GltfMember(sparse, "values");
  uint64_t count = 0, index_view = 0, index_offset = 0, component = 0, view = 0, offset = 0;
  ScalarType type = ScalarType::kUint8;
  if (!GltfNumber(sparse, "count", 0, &count) ||
      !GltfNumber(indices, "bufferView", kMaxNumber, &index_view) ||
      !GltfNumber(indices, "byteOffset", 0, &index_offset) ||
      !GltfNumber(indices, "componentType", 0, &component) || !TypeOf(component, &type) ||
      !GltfNumber(values, "bufferView", kMaxNumber, &view) ||
      !GltfNumber(values, "byteOffset", 0, &offset) || type >= ScalarType::kFloat32 ||
      count > accessor->count) {
    return Error(name + ": its sparse values have a wrong number");
  }
  const uint64_t value_bytes =
      ScalarSize(accessor->type) * static_cast<uint64_t>(accessor->components);
  MTDB_ASSIGN_OR_RETURN(GltfBytes places, BufferView(index_view));
  MTDB_ASSIGN_OR_RETURN(GltfBytes bytes, BufferView(view));
  const auto cut = [count](GltfBytes* part, uint64_t from, uint64_t size) {
    if (from > part->size || (part->size - from) / size < count) return false;
    part->begin += from;
    part->size = count * size;
    part->stride = 0;
    return true;
  };
  if (!cut(&places, index_offset, ScalarSize(type)) || !cut(&bytes, offset, value_bytes)) {
    return Error(name + ": " + std::to_string(count) +
                 " sparse values, but their bufferViews have fewer; the file is cut short");
  }
  auto made = std::make_shared<GltfSparse>();
  MTDB_ASSIGN_OR_RETURN(made->values, Load(bytes));
  GltfAccessor list{places, count, 1, type, false, nullptr};
  list.bytes.stride = ScalarSize(type);
  GltfValues reader(std::move(list));
  for (uint64_t i = 0; i < count; ++i) {
    std::array<double, 4> value;
    MTDB_RETURN_IF_ERROR(reader.Next(&value));
    const auto place = static_cast<uint64_t>(value[0]);
    if (value[0] < 0 || place >= accessor->count || (i > 0 && place <= made->places.back())) {
      return Error(name + ": sparse value " + std::to_string(i) + " is for value " +
                   std::to_string(place) + "; they ascend, and there are " +
                   std::to_string(accessor->count));
    }
    made->places.push_back(place);
  }
  accessor->sparse = std::move(made);
  return Status::Ok();
}

Status GltfValues::Fill() {
  constexpr uint64_t kBlock = 1 << 16;
  const GltfBytes& bytes = accessor_.bytes;
  first_ = next_;
  held_ = std::min(std::max<uint64_t>(1, kBlock / bytes.stride), accessor_.count - next_);
  const uint64_t begin = first_ * bytes.stride;
  const uint64_t size = std::min(held_ * bytes.stride, bytes.size - begin);
  buffer_.assign(held_ * bytes.stride, std::byte{0});
  if (bytes.memory != nullptr) {
    std::copy_n(bytes.memory->data() + bytes.begin + begin, size, buffer_.data());
    return Status::Ok();
  }
  if (bytes.file == nullptr) return Status::Ok();  // zeros
  MTDB_ASSIGN_OR_RETURN(const size_t read,
                        bytes.file->ReadAt(bytes.begin + begin, std::span(buffer_).first(size)));
  return read == size ? Status::Ok()
                      : BadInput(bytes.file->path() + ": the file has become shorter");
}

Status GltfValues::Next(std::array<double, 4>* value) {
  MTDB_CHECK(next_ < accessor_.count, "no values are left");
  if (next_ == first_ + held_) MTDB_RETURN_IF_ERROR(Fill());
  const std::byte* at = buffer_.data() + (next_ - first_) * accessor_.bytes.stride;
  if (const GltfSparse* s = accessor_.sparse.get();
      s != nullptr && stood_in_ < s->places.size() && s->places[stood_in_] == next_) {
    at = s->values.data() + stood_in_++ * (s->values.size() / s->places.size());
  }
  ++next_;
  *value = {};
  for (int c = 0; c < accessor_.components; ++c) {
    const auto as = [&]<typename T>(T number) {
      std::memcpy(&number, at, sizeof(number));
      at += sizeof(number);
      if constexpr (!std::numeric_limits<T>::is_integer) return static_cast<double>(number);
      if (!accessor_.normalized) return static_cast<double>(number);
      return std::max(
          -1.0, static_cast<double>(number) / static_cast<double>(std::numeric_limits<T>::max()));
    };
    double& out = (*value)[static_cast<size_t>(c)];
    switch (accessor_.type) {
      case ScalarType::kInt8: out = as(int8_t{}); break;
      case ScalarType::kUint8: out = as(uint8_t{}); break;
      case ScalarType::kInt16: out = as(int16_t{}); break;
      case ScalarType::kUint16: out = as(uint16_t{}); break;
      case ScalarType::kUint32: out = as(uint32_t{}); break;
      case ScalarType::kFloat64: out = as(double{}); break;
      default: out = as(float{}); break;
    }
  }
  return Status::Ok();
}

}  // namespace mtdb::internal
