// SPDX-License-Identifier: Apache-2.0
// Queries and sessions that wait for nothing, over a source that answers late: in the end they say
// what those that wait say.
#include <chrono>
#include <memory>
#include <thread>

#include "query/session.h"
#include "store/database.h"
#include "tests/everything/ways.h"
#include "tests/query/late_source.h"

namespace mtdb::everything {

namespace {

using Clock = std::chrono::steady_clock;

// For what never comes to its end, on a machine that is busy.
constexpr auto kMostTime = std::chrono::seconds(600);

Result<std::shared_ptr<Surface>> OpenLate(const Asked& asked) {
  MTDB_ASSIGN_OR_RETURN(const std::shared_ptr<Database> database,
                        Database::Open(asked.world->Store(asked.store).path));
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<ClusterSource> source, database->OpenObject(asked.name));
  SurfaceOptions options;
  options.threads = 2;
  if (asked.question->implicit) options.form = RuntimeForm::kImplicit;
  const mtdb::testing::LateOptions late{.seed = asked.question->text().size() + 1,
                                        .twice = asked.step->Flag("detour")};
  return Surface::Open(std::make_shared<mtdb::testing::LateSource>(std::move(source), late),
                       options);
}

// A budget of bytes or of time ends where it happens to.
bool HasOneAnswer(const Question& question) { return !question.has_bytes && !question.has_time; }

// Calls `ask` until it says that it has all; false with a reason when that does not come.
template <typename Ask>
bool Repeat(Ask&& ask, Answer* answer) {
  const Clock::time_point until = Clock::now() + kMostTime;
  while (true) {
    const Result<bool> all = ask();
    if (!all.ok() && all.status().code() != StatusCode::kNotYet) {
      answer->refused = all.status().message();
      return false;
    }
    if (all.ok() && *all) return true;
    if (Clock::now() > until) {
      answer->refused = "what never waits never comes to its end";
      return false;
    }
    std::this_thread::sleep_for(std::chrono::microseconds(200));
  }
}

}  // namespace

bool AskAvailable(const Asked& asked, Answer* answer) {
  if (!HasOneAnswer(*asked.question)) return false;
  const auto surface = OpenLate(asked);
  if (!surface.ok()) {
    answer->refused = surface.status().message();
    return true;
  }
  Query query = asked.question->query;
  query.available_only = true;
  Repeat(
      [&]() -> Result<bool> {
        answer->mesh = {};
        TriangleMeshSink sink(&answer->mesh);
        MTDB_ASSIGN_OR_RETURN(const ExtractStats stats, (*surface)->Extract(query, sink));
        if ((stats.limit == QueryLimit::kMissing) == stats.missing.empty()) {
          return Corrupt("what is missing is not what ended the refinement");
        }
        if (stats.limit == QueryLimit::kMissing) return false;
        Take(stats, answer);
        return true;
      },
      answer);
  return true;
}

bool AskAvailableStream(const Asked& asked, Answer* answer) {
  if (asked.question->normals || !HasOneAnswer(*asked.question)) return false;
  const auto surface = OpenLate(asked);
  const auto fail = [&](const Status& status) {
    answer->refused = status.message();
    return true;
  };
  if (!surface.ok()) return fail(surface.status());
  auto session = Session::Open(*surface, {.available_only = true});
  if (!session.ok()) return fail(session.status());
  std::unique_ptr<UpdateEncoder> encoder;
  UpdateDecoder decoder;
  const bool came = Repeat(
      [&]() -> Result<bool> {
        MTDB_ASSIGN_OR_RETURN(const BaseMesh base, (*session)->Base());
        const ObjectRecord& record = (*surface)->record();
        const auto remember = static_cast<uint32_t>(asked.step->Int("remember", 1000));
        encoder = std::make_unique<UpdateEncoder>(
            ClientMeshOptions{record.grid, record.attributes, remember}, base);
        MTDB_RETURN_IF_ERROR(decoder.Feed(encoder->start()));
        return true;
      },
      answer);
  if (!came) return true;
  Query query = asked.question->query;
  if (asked.step->Flag("detour")) query.max_milliseconds = 0.1;  // of each call
  const bool all = Repeat(
      [&]() -> Result<bool> {
        std::vector<UpdateBatch> batches;
        MTDB_ASSIGN_OR_RETURN(const SessionUpdate update, (*session)->Update(query, &batches));
        MTDB_RETURN_IF_ERROR(decoder.Feed(encoder->Encode(batches, MeetsOf(query))));
        if (update.stats.limit == QueryLimit::kMissing || update.stats.limit == QueryLimit::kTime) {
          return false;
        }
        Take(update.stats, answer);
        return true;
      },
      answer);
  if (!all) return true;
  TakeClientMesh(decoder.mesh(), answer);
  answer->triangles = answer->mesh.triangles.size();
  return true;
}

}  // namespace mtdb::everything
