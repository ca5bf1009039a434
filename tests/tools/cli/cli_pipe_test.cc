// SPDX-License-Identifier: Apache-2.0
// Standard input as a mesh and as a query.
#include <csignal>
#include <sys/stat.h>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {
namespace {

// mtdb with standard input from a shell's pipe or file.
Outcome RunWith(const std::string& before, const Arguments& arguments) {
  const Folder folder;
  std::string command = before + " '" MTDB_BINARY "'";
  for (const std::string& a : arguments) command += " '" + a + "'";
  command += " >'" + folder.File("out") + "' 2>'" + folder.File("err") + "'";
  const int status = std::system(command.c_str());
  Outcome outcome;
  if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
  outcome.out = ReadText(folder.File("out"));
  outcome.err = ReadText(folder.File("err"));
  return outcome;
}

}  // namespace

TEST_CASE("ingest reads standard input, a pipe, compressed or of a format without a magic word",
          "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string obj = folder.File("full.obj");
  RunOk({"extract", example.store, obj});
  const auto digest = [&](const std::string& before, const std::string& format) {
    const std::string store = folder.File("s.mtdb");
    Arguments ingest{"ingest", "-", store, "--name", "sculpture", "--replace", "--json"};
    if (!format.empty()) ingest.insert(ingest.end(), {"--format", format});
    const Outcome outcome = RunWith(before, ingest);
    INFO(before << "\n" << outcome.err);
    REQUIRE(outcome.exit_code == 0);
    return ParseJson(outcome.out).at("digest");
  };
  const Json expected = example.info.at("digest");
  CHECK(digest("cat '" + example.mesh + "' |", "") == expected);
  CHECK(digest("cat '" + example.mesh + "' |", "ply") == expected);
  CHECK(digest("gzip -c '" + example.mesh + "' |", "") == expected);
  CHECK(digest("<'" + example.mesh + "'", "") == expected);
  const Json of_obj = RunJson({"ingest", obj, folder.File("o.mtdb"), "--name", "sculpture"});
  CHECK(digest("cat '" + obj + "' |", "obj") == of_obj.at("digest"));

  const Outcome info = RunWith("cat '" + obj + "' |", {"info", "-", "--format", "obj", "--json"});
  CHECK(info.exit_code == 0);
  CHECK(ParseJson(info.out).at("triangles") == example.info.at("triangles"));
  const Outcome unknown = RunWith("cat '" + obj + "' |", {"info", "-"});
  CHECK(unknown.exit_code == 1);
  CHECK_THAT(unknown.err, Catch::Contains("standard input: not a mesh file"));
  const Outcome empty = RunWith("</dev/null", {"info", "-"});
  CHECK(empty.exit_code == 1);
  CHECK_THAT(empty.err, Catch::Contains("standard input: the file is empty"));
}

TEST_CASE("what standard input cannot be is wrong usage", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  RunFails(2, {"ingest", "-", store}, {"--name"});
  RunFails(2, {"ingest", "-", "-", store, "--name", "a"}, {"once"});
  RunFails(2, {"ingest", "-", store, "--name", "a", "--format", "png"}, {"--format", "png"});
  RunFails(2, {"ingest", "-", store, "--name", "a", "--resume"}, {"--resume"});
  RunFails(2, {"ingest", SmallExample().mesh, store, "--format", "ply"}, {"--format"});
}

TEST_CASE("a query comes from standard input", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const Outcome outcome =
      RunWith(R"(echo '{"threshold": 0.05}' |)",
              {"extract", example.store, folder.File("a.ply"), "--query", "-", "--json"});
  INFO(outcome.err);
  REQUIRE(outcome.exit_code == 0);
  const Json expected =
      RunJson({"extract", example.store, folder.File("b.ply"), "--error", "0.05"});
  CHECK(ParseJson(outcome.out).at("triangles") == expected.at("triangles"));
}

TEST_CASE("ingest reads a file compressed by gzip under the name without .gz", "[cli]") {
  const Example& example = SmallExample();
  const Folder folder;
  const std::string path = folder.File("sculpture.ply.gz");
  REQUIRE(std::system(("gzip -c '" + example.mesh + "' >'" + path + "'").c_str()) == 0);
  const Json json = RunJson({"ingest", path, folder.File("s.mtdb")});
  CHECK(json.at("object") == "sculpture");
  CHECK(json.at("digest") == example.info.at("digest"));
  const std::string bytes = ReadText(path);
  WriteText(path, bytes.substr(0, bytes.size() / 2));
  RunFails(1, {"ingest", path, folder.File("t.mtdb"), "--quiet"}, {path, "cut short"});
  CHECK(!Exists(folder.File("t.mtdb")));
}

namespace {

// An ingest of what `before` writes is sent a signal once it has begun to read.
Outcome Interrupted(const std::string& before, int signal, const Folder& folder) {
  const std::string said = folder.File("err"), fifo = folder.File("fifo");
  REQUIRE(::mkfifo(fifo.c_str(), 0600) == 0);
  const pid_t writer = ::fork();
  if (writer == 0) {
    ::setpgid(0, 0);
    ::execl("/bin/bash", "bash", "-c", ("exec >'" + fifo + "'; " + before).c_str(), nullptr);
    ::_exit(127);
  }
  const pid_t reader = ::fork();
  if (reader == 0) {
    ::dup2(::open(fifo.c_str(), O_RDONLY), 0);
    ::dup2(::open(said.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), 2);
    ::alarm(kTimeoutSeconds);
    ::execl(MTDB_BINARY, MTDB_BINARY, "ingest", "-", folder.File("s.mtdb").c_str(), "--name", "a",
            "--format", "obj", nullptr);
    ::_exit(127);
  }
  // What it says first comes after it has its handlers.
  while (ReadText(said).empty()) ::usleep(2000);
  ::kill(reader, signal);
  Outcome outcome = Finish(reader);
  ::kill(-writer, SIGKILL);
  ::kill(writer, SIGKILL);
  Finish(writer);
  outcome.err = ReadText(said);
  return outcome;
}

}  // namespace

TEST_CASE("standard input without an end does not keep an ingest from being stopped", "[cli]") {
  // Much comes, nothing comes, a little comes now and then.
  for (const std::string before :
       {"exec yes v 1 2 3", "exec sleep 300", "while echo v 1 2 3; do sleep 0.1; done"}) {
    for (const int signal : {SIGTERM, SIGINT}) {
      const Folder folder;
      const Outcome outcome = Interrupted(before, signal, folder);
      INFO(before << ", signal " << signal << ": " << outcome.err);
      CHECK(outcome.exit_code == 1);
      CHECK_THAT(outcome.err, Catch::Contains("interrupted"));
      CHECK(!Exists(folder.File("s.mtdb")));
    }
  }
}

TEST_CASE("endless input that is no mesh ends an ingest by itself", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb");
  const auto refused = [&](const std::string& before, const std::string& format,
                           const std::string& words) {
    const Outcome outcome =
        RunWith(before, {"ingest", "-", store, "--name", "a", "--quiet", "--format", format});
    INFO(before << " as " << format << ": " << outcome.err);
    CHECK(outcome.exit_code == 1);
    CHECK(IsOneLine(outcome.err));
    CHECK_THAT(outcome.err, Catch::Contains(words));
    CHECK(!Exists(store));
  };
  for (const std::string format : {"stl", "ply", "obj", "off", "glb", "gltf", "drc"}) {
    refused("</dev/zero", format, "standard input: ");
  }
  const Outcome query = RunWith(
      "</dev/zero", {"extract", SmallExample().store, folder.File("a.ply"), "--query", "-"});
  CHECK(query.exit_code == 1);
  CHECK_THAT(query.err, Catch::Contains("more than 64 MiB"));
  refused("yes '# nothing' |", "obj", "no statement");
  refused("{ printf 'ply\\nformat ascii 1.0\\n'; yes comment; } |", "ply", "does not end");
}

TEST_CASE("a pipe by its name is refused at once, whatever it is called", "[cli]") {
  const Folder folder;
  for (const std::string suffix : {"ply", "obj", "tif", "asc", "hgt", "dem", "mtdb"}) {
    const std::string fifo = folder.File("a." + suffix);
    REQUIRE(::mkfifo(fifo.c_str(), 0600) == 0);
    RunFails(1, {"ingest", fifo, folder.File("s.mtdb"), "--name", "a", "--quiet"},
             {fifo, "regular file"});
    RunFails(1, {"info", fifo}, {fifo, "regular file"});
  }
}

TEST_CASE("temporary files take no more than --max-tmp", "[cli]") {
  const Folder folder;
  const std::string store = folder.File("s.mtdb"), mesh = folder.File("a.ply");
  const Outcome outcome = RunWith(
      "yes 'v 1 2 3' |",
      {"ingest", "-", store, "--name", "a", "--quiet", "--format", "obj", "--max-tmp", "4M"});
  CHECK(outcome.exit_code == 1);
  CHECK_THAT(outcome.err, Catch::Contains("MiB") && Catch::Contains("--max-tmp"));
  CHECK(!Exists(store));
  RunOk({"generate", "sculpture", mesh, "--triangles", "30000"});
  RunFails(1, {"ingest", mesh, store, "--name", "a", "--quiet", "--max-tmp", "100K"},
           {"--max-tmp", "--resume"});
  RunOk({"ingest", mesh, store, "--name", "a", "--quiet", "--resume", "--max-tmp", "1G"});
  RunOk({"verify", store});
}

}  // namespace mtdb::test
