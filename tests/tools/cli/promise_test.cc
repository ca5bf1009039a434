// SPDX-License-Identifier: Apache-2.0
// The bound and the shortfall of an answer, in every way of asking.
#include <catch2/catch.hpp>
#include <cmath>

#include "query/query_json.h"
#include "query/surface.h"
#include "store/database.h"
#include "tests/tools/http_testing.h"
#include "tools/c/mtdb.h"
#include "tools/client/client.h"
#include "tools/client/shortfall_json.h"
#include "tools/request/report_json.h"

namespace mtdb::test {
namespace {

// What a way of asking says: [error_bound, shortfall], where it says it.
Json Said(double bound, const Shortfall& shortfall) {
  return {bound, ParseJson(ShortfallJson(shortfall).Text())};
}

Json ByC(const std::string& store, const std::string& query) {
  mtdb_database* database = nullptr;
  mtdb_object* object = nullptr;
  mtdb_query* asked = nullptr;
  mtdb_cut* cut = nullptr;
  mtdb_stats stats;
  MTDB_INIT(stats);
  REQUIRE(mtdb_open(store.c_str(), nullptr, &database, nullptr) == MTDB_OK);
  REQUIRE(mtdb_open_object(database, nullptr, nullptr, &object, nullptr) == MTDB_OK);
  REQUIRE(mtdb_create_query(object, query.c_str(), &asked, nullptr) == MTDB_OK);
  REQUIRE(mtdb_select(object, asked, nullptr, &cut, nullptr) == MTDB_OK);
  REQUIRE(mtdb_get_cut_stats(cut, &stats, nullptr) == MTDB_OK);
  mtdb_free_cut(cut);
  mtdb_free_query(asked);
  mtdb_free_object(object);
  mtdb_free_database(database);
  Shortfall shortfall;
  if (stats.shortfall_triangles > 0) {
    const double* const low = stats.shortfall_bounds_min;
    const double* const high = stats.shortfall_bounds_max;
    shortfall = {stats.shortfall_triangles,
                 stats.shortfall_excess,
                 {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}}};
  }
  return Said(stats.error_bound, shortfall);
}

}  // namespace

TEST_CASE("all ways of asking tell the same bound and the same shortfall", "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("a.ply");
  const std::string store = folder.File("a.mtdb");
  const std::string out = folder.File("out.ply");
  const std::string file = folder.File("query.json");
  RunOk({"generate", "terrain", mesh, "--triangles", "3000"});
  // A step that float32 holds: files do not round again.
  RunOk({"ingest", mesh, store, "--quiet", "--step", "0.0625"});
  const double h = RunJson({"info", store}).at("objects").at(0).at("rounding_error");
  REQUIRE(h > 0.01);
  REQUIRE(h < 0.0625);
  const ServerProcess server(store);
  const std::string url = server.url();
  const auto surface = *Surface::Open(*(*Database::Open(store))->OpenObject(""));
  uint64_t met = 0, unmet = 0;
  for (const std::string region :
       {R"("region": {"sphere": {"centre": [5, 5, 0], "radius": 2}},)", ""}) {
    for (const std::string rest :
         {R"("threshold": 0)", R"("threshold": 0.005)", R"("threshold": 0.02)",
          R"("threshold": 0.1)", R"("threshold": 0.5)", R"("threshold": "full")",
          R"("threshold": {"linear": {"point": [5, 5, 0], "base": 0, "slope": 0.02}})",
          R"("threshold": 0.01, "max_triangles": 200)"}) {
      const std::string query = "{" + region + rest + "}";
      INFO(query);
      WriteText(file, query);
      const Query parsed = ParseQuery(query, surface->record()).value();
      const ExtractStats stats = surface->Select(parsed)->stats();
      const Json expected = Said(stats.error_bound, stats.shortfall);
      (stats.shortfall.any() ? unmet : met) += 1;
      if (const auto asked = parsed.threshold->constant(); asked && *asked >= 0) {
        CHECK((stats.error_bound <= *asked) == !stats.shortfall.any());
        if (stats.shortfall.any()) CHECK(stats.shortfall.excess == stats.error_bound - *asked);
      }
      CHECK(ByC(store, query) == expected);
      const Json extracted = RunJson({"extract", store, out, "--query", file});
      CHECK(Json({extracted.at("error_bound"), extracted.at("shortfall")}) == expected);
      const Json rendered =
          RunJson({"render", store, folder.File("a.png"), "--query", file, "--size", "40x30"});
      CHECK(Json({rendered.at("error_bound"), rendered.at("shortfall")}) == expected);
      const Json fetched = RunJson({"fetch", url, out, "--query", file});
      CHECK(Json({fetched.at("error_bound"), fetched.at("shortfall")}) == expected);
      const std::string text = RunOk({"extract", store, out, "--query", file});
      char bound[40];
      std::snprintf(bound, sizeof(bound), "error at most %.6g ", stats.error_bound);
      CHECK_THAT(text, Catch::Contains(bound));
      CHECK((text.find("NOT MET") != std::string::npos) == stats.shortfall.any());
      CHECK_THAT(text, Catch::Contains(ShortfallText(stats.shortfall, LimitName(stats.limit))));
      CHECK_THAT(RunOk({"fetch", url, out, "--query", file}),
                 Catch::Contains(ShortfallText(stats.shortfall, LimitName(stats.limit))));
      // From the root, a session learns no more of the errors than a search.
      const auto session = RemoteSession::Open(url).value();
      const RemoteUpdate update = session->Update(query).value();
      CHECK(Said(update.error_bound, update.shortfall) == expected);
    }
  }
  CHECK(met > 5);
  CHECK(unmet > 7);
}

TEST_CASE("probe says when its accuracy cannot be had, and no bound without a hit", "[cli]") {
  const Folder folder;
  const std::string mesh = folder.File("a.ply");
  const std::string store = folder.File("a.mtdb");
  RunOk({"generate", "terrain", mesh, "--triangles", "3000"});
  RunOk({"ingest", mesh, store, "--quiet", "--step", "0.0625"});
  const Json fine = RunJson({"probe", store, "--point", "5,5,1", "--error", "0.001"});
  CHECK(fine.at("excess") == fine.at("error_bound").get<double>() - 0.001);
  CHECK(fine.at("excess") > 0);
  CHECK_THAT(RunOk({"probe", store, "--point", "5,5,1", "--error", "0.001"}),
             Catch::Contains("NOT MET"));
  const Json coarse = RunJson({"probe", store, "--point", "5,5,1", "--error", "0.1"});
  CHECK(coarse.at("excess") == 0);
  CHECK(coarse.at("error_bound") <= 0.1);
  CHECK(RunJson({"probe", store, "--point", "5,5,1"}).at("excess") == 0);
  for (const Arguments& none :
       {Arguments{"--ray", "5,5,9,0,0,1"}, Arguments{"--point", "5,5,90", "--limit", "1"}}) {
    Arguments probe{"probe", store};
    probe.insert(probe.end(), none.begin(), none.end());
    const Json missed = RunJson(probe);
    CHECK(missed.at("hit") == false);
    CHECK_FALSE(missed.contains("error_bound"));
  }
}

}  // namespace mtdb::test
