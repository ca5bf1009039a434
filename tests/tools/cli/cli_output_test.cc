// SPDX-License-Identifier: Apache-2.0
// Where meshes are written to, and what is said of requests that cannot be met.
#include <catch2/catch.hpp>
#include <sys/stat.h>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// The words of a shell, with the program as $M. Its exit status.
int Shell(const std::string& line) {
  const std::string all = "M=" + std::string(MTDB_BINARY) + "; " + line;
  const int status = std::system(("timeout 200 bash -c '" + all + "'").c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

}  // namespace

TEST_CASE("a mesh goes to standard output in the format that is asked for", "[cli]") {
  const Example& e = SmallExample();
  const Folder folder;
  for (const std::string format : {"ply", "obj", "stl", "off", "drc"}) {
    INFO(format);
    const std::string file = folder.File("file." + format);
    const std::string piped = folder.File("piped." + format);
    RunOk({"extract", e.store, file, "--error", "1%"});
    CHECK(Shell("$M extract " + e.store + " - --format " + format + " --error 1% 2>" +
                folder.File("said") + " | cat > " + piped) == 0);
    CHECK(ReadText(piped) == ReadText(file));
    CHECK_THAT(ReadText(folder.File("said")), Catch::Contains("error at most"));
  }
  RunFails(2, {"extract", e.store, "-"}, {"--format"});
  RunFails(2, {"extract", e.store, folder.File("a.ply"), "--format", "ply"}, {"--format"});
  RunFails(2, {"extract", e.store, "-", "--format", "png"}, {"png"});
}

TEST_CASE("who reads a part of the output ends the program quietly", "[cli]") {
  const Example& e = TheExample();
  const Folder folder;
  CHECK(Shell("set -o pipefail; $M extract " + e.store + " - --format obj 2>" +
              folder.File("said") + " | head -1 > /dev/null") == 0);
  CHECK(ReadText(folder.File("said")).empty());
}

TEST_CASE("outputs follow links, keep permissions, and go into pipes and devices", "[cli]") {
  const Example& e = SmallExample();
  const Folder folder;
  const std::string target = folder.File("target.ply"), link = folder.File("link.ply");
  RunOk({"extract", e.store, target});
  const std::string bytes = ReadText(target);
  REQUIRE(::chmod(target.c_str(), 0640) == 0);
  std::filesystem::create_symlink("target.ply", link);
  RunOk({"extract", e.store, link, "--error", "1%"});
  CHECK(std::filesystem::is_symlink(link));
  CHECK(ReadText(target) != bytes);
  struct stat info {};
  REQUIRE(::stat(target.c_str(), &info) == 0);
  CHECK((info.st_mode & 0777) == 0640);
  // A link whose file is not there yet.
  std::filesystem::create_symlink(folder.File("new.ply"), folder.File("dangling.ply"));
  RunOk({"extract", e.store, folder.File("dangling.ply")});
  CHECK(ReadText(folder.File("new.ply")) == bytes);
  // A pipe with a name.
  const std::string fifo = folder.File("fifo.ply");
  REQUIRE(::mkfifo(fifo.c_str(), 0600) == 0);
  CHECK(Shell("cat " + fifo + " > " + folder.File("read.ply") + " & $M extract " + e.store + " " +
              fifo + " > /dev/null && wait") == 0);
  CHECK(ReadText(folder.File("read.ply")) == bytes);
  std::filesystem::create_symlink("/dev/null", folder.File("null.ply"));
  RunOk({"extract", e.store, folder.File("null.ply")});
  CHECK(std::filesystem::is_symlink(folder.File("null.ply")));
}

TEST_CASE("a region beside the surface is told of, and succeeds", "[cli]") {
  const Example& e = SmallExample();
  const Folder folder;
  const std::string out = folder.File("a.ply");
  const Arguments beside{"extract", e.store, out, "--sphere", "100,100,100,1"};
  CHECK_THAT(RunOk(beside), Catch::Contains("WARNING: nothing of the surface is in the region") &&
                                Catch::Contains("the surface lies within"));
  CHECK(RunJson(beside).at("region_missed") == true);
  const Json inside = RunJson({"extract", e.store, out, "--sphere", "0,0,0,1"});
  CHECK(inside.at("region_missed") == false);
  CHECK(RunJson({"extract", e.store, out}).at("region_missed") == false);
}

TEST_CASE("the bound outside of a region is told apart from that inside", "[cli]") {
  const Example& e = TheExample();
  const Folder folder;
  const std::string out = folder.File("a.ply");
  const Json part = RunJson({"extract", e.store, out, "--sphere", "0.6,0,0.6,0.1"});
  CHECK(part.at("error_bound_outside").get<double>() > part.at("error_bound").get<double>());
  CHECK_THAT(RunOk({"extract", e.store, out, "--sphere", "0.6,0,0.6,0.1"}),
             Catch::Contains("that holds in the region; outside of it the error is at most"));
  CHECK(RunJson({"extract", e.store, out}).at("error_bound_outside").is_null());
  CHECK(RunJson({"extract", e.store, out, "--sphere", "0.6,0,0.6,0.1", "--clip"})
            .at("error_bound_outside")
            .is_null());
}

TEST_CASE("a limit of triangles that cannot be kept is told of, with the reason", "[cli]") {
  const Example& e = SmallExample();
  const Folder folder;
  const std::string out = folder.File("a.ply");
  const auto least = e.info.at("root_triangles").get<uint64_t>();
  REQUIRE(least > 1);
  const Json unmet = RunJson({"extract", e.store, out, "--triangles", "1"}).at("unmet_limit");
  CHECK(unmet.at("max_triangles") == 1);
  CHECK(unmet.at("least") == least);
  CHECK_THAT(RunOk({"extract", e.store, out, "--triangles", "1"}),
             Catch::Contains("WARNING: the limit of 1 triangles cannot be kept") &&
                 Catch::Contains("no coarser mesh is stored"));
  CHECK(RunJson({"extract", e.store, out, "--triangles", std::to_string(least)})
            .at("unmet_limit")
            .is_null());
  // Nobody has asked for an error.
  CHECK_THAT(RunOk({"extract", e.store, out, "--triangles", std::to_string(least + 50)}),
             !Catch::Contains("NOT MET"));
}

TEST_CASE("what is said is short, and all of it with --verbose", "[cli]") {
  const Example& e = SmallExample();
  const Folder folder;
  const auto lines = [](const std::string& text) {
    return std::count(text.begin(), text.end(), '\n');
  };
  CHECK(lines(RunOk({"ingest", e.mesh, folder.File("s.mtdb")})) <= 3);
  CHECK(lines(RunOk({"ingest", e.mesh, folder.File("t.mtdb"), "--verbose"})) > 5);
  CHECK(lines(RunOk({"extract", e.store, folder.File("a.ply")})) <= 3);
  const std::string all = RunOk({"extract", e.store, folder.File("a.ply"), "--verbose"});
  CHECK(lines(all) > 3);
  CHECK_THAT(all, Catch::Contains("the accuracy that was asked for was reached"));
}

}  // namespace mtdb::test

namespace mtdb::test {

TEST_CASE("no output takes the place of a store or of a packed file, by whatever name", "[cli]") {
  const Example& e = SmallExample();
  const Folder folder;
  const std::string store = folder.File("s.mtdb"), packed = folder.File("p.mtdbp");
  std::filesystem::copy(e.store, store);
  RunOk({"pack", store, packed});
  const std::string page = folder.File("page");
  for (const std::string& kept : {store, packed}) {
    const std::string bytes = ReadText(kept);
    for (const std::string suffix : {"ply", "obj", "stl", "off", "glb", "drc"}) {
      const std::string soft = folder.File("soft." + suffix), hard = folder.File("hard." + suffix);
      std::filesystem::create_symlink(kept, soft);
      std::filesystem::create_hard_link(kept, hard);
      for (const std::string& name : {soft, hard}) {
        RunFails(1, {"extract", e.store, name, "--error", "10%"}, {name, "another name"});
        if (suffix == "ply") {
          RunFails(1, {"generate", "sculpture", name, "--triangles", "100"},
                   {name, "another name"});
        }
        std::filesystem::remove(name);
      }
    }
    const std::string picture = folder.File("a.png");
    std::filesystem::create_symlink(kept, picture);
    RunFails(1, {"render", e.store, picture, "--size", "64x64", "--draft"}, {"another name"});
    std::filesystem::remove(picture);
    // Standard output that is a store which somebody opened to append, or to write over.
    for (const std::string how : {">>", "1<>"}) {
      CHECK(Shell("$M extract " + e.store + " - --format ply " + how + kept + " 2>" +
                  folder.File("said")) == 1);
      CHECK_THAT(ReadText(folder.File("said")), Catch::Contains("another name"));
    }
    std::filesystem::create_directory(page);
    std::filesystem::create_hard_link(kept, page + "/index.html");
    CHECK(Run({"view", "--write-page", page}).exit_code == 1);
    std::filesystem::remove_all(page);
    CHECK(ReadText(kept) == bytes);
  }
  RunOk({"verify", store});
}

TEST_CASE("what is shown of a URL has no password and no signature", "[cli]") {
  const std::string secret = "S3cr3tS3cr3t";
  for (const std::string& url :
       {"http://user:" + secret + "@127.0.0.1:1/a.mtdbp", "http://127.0.0.1:1/a?sig=" + secret,
        "s3://bucket/../a?X-Amz-Signature=" + secret, "s3://user:" + secret + "@bucket/a"}) {
    for (const std::string verb : {"list", "info", "verify", "fetch", "follow", "serve"}) {
      Arguments arguments{verb, url};
      if (verb == "fetch") arguments.push_back("/nowhere/a.ply");
      if (verb == "follow") arguments.insert(arguments.end(), {"--path", "/nowhere"});
      if (verb != "serve") arguments.push_back("--json");
      const Outcome outcome = Run(arguments);
      INFO(Join(arguments) << "\n" << outcome.out << outcome.err);
      CHECK(outcome.exit_code > 0);
      CHECK(outcome.err.find(secret) == std::string::npos);
      CHECK(outcome.out.find(secret) == std::string::npos);
    }
  }
}

}  // namespace mtdb::test
