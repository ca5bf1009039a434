// SPDX-License-Identifier: Apache-2.0
// The handles of the C interface, and what all of its functions have in common.
#pragma once

#include <cstring>
#include <exception>
#include <initializer_list>
#include <memory>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "query/query_control.h"
#include "query/surface.h"
#include "store/base/out_of_memory.h"
#include "store/base/status.h"
#include "store/database.h"
#include "tools/c/mtdb.h"

// NOLINTBEGIN(readability-identifier-naming)
struct mtdb_database {
  std::shared_ptr<mtdb::Database> database;
};
struct mtdb_texts {
  std::vector<std::string> texts;
};
struct mtdb_json {
  std::string text;
};
struct mtdb_object {
  std::shared_ptr<mtdb::Database> database;
  std::shared_ptr<mtdb::Surface> surface;
};
struct mtdb_control {
  std::shared_ptr<mtdb::QueryControl> control;
};
struct mtdb_query {
  mtdb::Query query;  // without control
};
struct mtdb_cut {
  std::shared_ptr<mtdb::QueryControl> control;  // outlives the cut
  std::shared_ptr<mtdb::Surface> surface;
  mtdb::Cut cut;
  uint32_t row_bytes;
};
// NOLINTEND(readability-identifier-naming)

namespace mtdb::internal {

// Cuts at a whole character of UTF-8. `error` may be null.
void SetMessage(mtdb_error* error, const std::string& message);

// Runs what a function does. Exceptions, which only a lack of memory raises, end here.
template <typename Work>
mtdb_code Guarded(mtdb_error* error, Work&& work) {
  try {
    const Status status = work();
    SetMessage(error, status.message());
    return static_cast<mtdb_code>(status.code());
  } catch (const std::bad_alloc&) {
    SetMessage(error, OutOfMemory().message());
    return MTDB_NO_SPACE;
  } catch (const std::exception& e) {
    SetMessage(error, e.what());
    return MTDB_IO_ERROR;
  }
}

// kInvalidArgument when one of the pointers is null.
Status NeedAll(std::initializer_list<std::pair<const void*, const char*>> arguments);
Status NeedFinite(std::initializer_list<double> numbers, const char* name);
inline Status NeedFinite(Vec3d v, const char* name) { return NeedFinite({v.x, v.y, v.z}, name); }

inline Vec3d ToVec(const double* p) { return {p[0], p[1], p[2]}; }
inline void Put(Vec3d v, double* out) {
  for (int i = 0; i < 3; ++i) out[i] = v[i];
}

// What a callback's answer means: anything but 0 stops.
inline Status Answer(int stop) {
  if (stop == 0) return Status::Ok();
  return {StatusCode::kCancelled, "the callback asked to stop"};
}

// The struct of a caller who may know fewer or more members than this library. Null: all 0. Errors:
// kInvalidArgument when its size is not set, kUnsupported when a member that this library does not
// know is not 0.
Status TakeBytes(const void* given, const char* name, size_t size, void* taken);
template <typename T>
Result<T> Take(const T* given, const char* name) {
  T taken{};
  MTDB_RETURN_IF_ERROR(TakeBytes(given, name, sizeof(T), &taken));
  return taken;
}

// The structs of an array, which has its first one's size in between.
template <typename T>
Result<std::vector<T>> TakeAll(const T* given, size_t count, const std::string& name) {
  std::vector<T> taken;
  if (count == 0) return taken;
  MTDB_RETURN_IF_ERROR(NeedAll({{given, name.c_str()}}));
  const size_t size = given->struct_bytes;
  for (size_t i = 0; i < count; ++i) {
    const auto* const one =
        reinterpret_cast<const T*>(reinterpret_cast<const unsigned char*>(given) + i * size);
    const std::string where = name + "[" + std::to_string(i) + "]";
    MTDB_ASSIGN_OR_RETURN(taken.emplace_back(), Take(one, where.c_str()));
    if (taken.back().struct_bytes != size) {
      return InvalidArgument(where + ".struct_bytes: differs from that of the first");
    }
  }
  return taken;
}

// Fills a struct of the caller's. Errors: kInvalidArgument when its size is not set.
Status PutBytes(const void* filled, size_t size, const char* name, void* out);
template <typename T>
Status PutStruct(T filled, const char* name, T* out) {
  return PutBytes(&filled, sizeof(T), name, out);
}

// What open and serve have in common: NULL and 0 stand for the defaults.
inline void SetCache(const char* directory, uint64_t bytes, OpenOptions* options) {
  if (directory != nullptr) options->cache_directory = directory;
  if (bytes != 0) options->cache_directory_bytes = bytes;
}

// What cancels a call; null: nothing.
inline QueryControl* ControlOf(const mtdb_control* control) {
  return control == nullptr ? nullptr : control->control.get();
}

// The members of mtdb_stats and mtdb_update that tell a shortfall.
template <typename T>
void PutShortfall(const Shortfall& shortfall, T* out) {
  out->shortfall_triangles = shortfall.triangles;
  out->shortfall_excess = shortfall.excess;
  if (!shortfall.any()) return;
  Put(shortfall.bounds.min, out->shortfall_bounds_min);
  Put(shortfall.bounds.max, out->shortfall_bounds_max);
}

// A probe's accuracy. Without an error that is allowed: full resolution, a raster's own surface.
template <typename Options>
Result<Options> ProbeOptionsOf(const mtdb_probe_options* options) {
  MTDB_ASSIGN_OR_RETURN(const mtdb_probe_options given, Take(options, "options"));
  if (!(given.error >= 0)) return InvalidArgument("options.error: expected 0 or more");
  Options with;
  with.error_model = given.error == 0 ? -1 : given.error;
  with.control = ControlOf(given.control);
  return with;
}

// Attribute i of the layout, whose names live as long as it does.
Status PutAttribute(const AttributeLayout& layout, uint32_t i, mtdb_attribute* attribute);

// Passes blocks of bytes on to a function of the caller.
inline Status Receive(int (*receive)(void*, const unsigned char*, size_t), void* user,
                      const void* bytes, size_t size) {
  return Answer(receive(user, static_cast<const unsigned char*>(bytes), size));
}

}  // namespace mtdb::internal
