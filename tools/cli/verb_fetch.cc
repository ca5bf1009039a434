#include <chrono>
#include <memory>

#include "codecs/mesh_file/atomic_file.h"
#include "codecs/mesh_file/mesh_file.h"
#include "tools/cli/verbs.h"
#include "tools/client/client.h"
#include "tools/client/shortfall_json.h"
#include "tools/request/report_json.h"

namespace mtdb {

namespace {

using Clock = std::chrono::steady_clock;

void PrintAnswer(const QueryArguments& arguments, const FetchAnswer& a, double seconds) {
  if (arguments.json) {
    PrintJson({{"url", arguments.store},
               {"path", a.path},
               {"output", arguments.output},
               {"triangles", a.triangles},
               {"vertices", a.vertices},
               {"active_triangles", a.active_triangles},
               {"error_bound", a.error_bound},
               {"shortfall", ShortfallJson(a.shortfall)},
               {"limit", a.limit},
               {"clusters_read", a.clusters_read},
               {"clusters_cached", a.clusters_cached},
               {"clusters_total", a.clusters_total},
               {"bytes_read", a.bytes_read},
               {"bytes_received", a.bytes_received},
               {"seconds", seconds}});
    return;
  }
  using Count = unsigned long long;
  std::printf("%s: %llu triangles, %llu vertices, error at most %.6g\n", arguments.output.c_str(),
              Count{a.triangles}, Count{a.vertices}, a.error_bound);
  std::fputs(ShortfallText(a.shortfall, a.limit).c_str(), stdout);
  std::printf("  %llu triangles within reach of the region; refined until the limit of %s\n",
              Count{a.active_triangles}, a.limit.c_str());
  std::printf("  the server read %llu of %llu clusters, %.1f KB; %llu were in its cache\n",
              Count{a.clusters_read}, Count{a.clusters_total},
              static_cast<double>(a.bytes_read) / 1e3, Count{a.clusters_cached});
  std::printf("  received %.1f KB in %.1f ms\n", static_cast<double>(a.bytes_received) / 1e3,
              1e3 * seconds);
}

}  // namespace

Status Fetch(const QueryArguments& arguments) {
  const Clock::time_point begin = Clock::now();
  MTDB_ASSIGN_OR_RETURN(const QueryJson query, QueryOf(arguments.query, arguments.size));
  if (arguments.print_query) {
    PrintJson(query);
    return Status::Ok();
  }
  MTDB_ASSIGN_OR_RETURN(const MeshFormat format, WrittenMeshFormatOf(arguments.output));
  FetchOptions options;
  options.name = arguments.name;
  options.format = format.suffixes[0];
  options.timeout_seconds = arguments.timeout_seconds;
  std::unique_ptr<AtomicFile> output;
  const auto receive = [&](std::string_view piece) -> Status {
    if (output == nullptr) {
      MTDB_ASSIGN_OR_RETURN(output, AtomicFile::Create(arguments.output));
    }
    return output->Append(piece);
  };
  MTDB_ASSIGN_OR_RETURN(const FetchAnswer answer,
                        FetchMesh(arguments.store, query.dump(), options, receive));
  MTDB_RETURN_IF_ERROR(receive(""));
  MTDB_RETURN_IF_ERROR(output->Commit());
  PrintAnswer(arguments, answer, std::chrono::duration<double>(Clock::now() - begin).count());
  return Status::Ok();
}

}  // namespace mtdb
