// SPDX-License-Identifier: Apache-2.0
// The ways of asking. Each gets a question and gives back a mesh and what was said of it.
#include "tests/everything/ways.h"

#include <algorithm>
#include <atomic>
#include <cstring>
#include <filesystem>

#include "query/query_json.h"
#include "query/surface.h"
#include "store/database.h"
#include "tests/everything/output_files.h"
#include "tests/everything/world.h"
#include "tests/query/late_source.h"
#include "tests/support/client_mesh_check.h"
#include "tests/support/file_server.h"
#include "tests/support/raw_session.h"
#include "tools/c/mtdb.h"

namespace mtdb::everything {

std::string NewFile(const Asked& asked, const std::string& extension) {
  static std::atomic<int> next{0};
  return asked.world->Folder("out/o" + std::to_string(next++) + "." + extension);
}

namespace {

std::string Format(const Asked& asked) { return asked.step->Text("output", "ply"); }

}  // namespace

// ---- in this process ----

void Take(const ExtractStats& stats, Answer* answer) {
  answer->has_rows = true;
  answer->exact = true;
  answer->triangles = stats.triangles;
  answer->active = stats.active_triangles;
  answer->bound = stats.error_bound;
  answer->excess = stats.shortfall.excess;
  constexpr const char* kLimits[] = {"accuracy", "triangles", "bytes", "time"};
  answer->limit = kLimits[static_cast<size_t>(stats.limit)];
}

void TakeClientMesh(const ClientMesh& client, Answer* answer) {
  const std::string fault = mtdb::testing::ClientMeshFault(client);
  if (!fault.empty()) answer->refused = "the client's mesh: " + fault;
  TriangleMesh& mesh = answer->mesh;
  mesh = mtdb::testing::Compacted(client);
  mesh.header.attributes = client.options().attributes;
  for (uint32_t v = 0; v < client.vertex_slots(); ++v) {
    if (!client.has_vertex(v)) continue;
    const ByteSpan row = client.row(v);
    mesh.rows.insert(mesh.rows.end(), row.begin(), row.end());
  }
  answer->has_rows = true;
  answer->exact = true;
  answer->any_bound = true;
}

namespace {

void FromCpp(const Asked& asked, const Result<Query>& query, Answer* answer) {
  const auto fail = [&](const Status& status) { answer->refused = status.message(); };
  if (!query.ok()) return fail(query.status());
  const auto database = Database::Open(asked.world->Store(asked.store).path);
  if (!database.ok()) return fail(database.status());
  const auto source = (*database)->OpenObject(asked.name);
  if (!source.ok()) return fail(source.status());
  SurfaceOptions options;
  options.threads = 2;
  if (asked.question->implicit) options.form = RuntimeForm::kImplicit;
  const auto surface = Surface::Open(*source, options);
  if (!surface.ok()) return fail(surface.status());
  TriangleMeshSink sink(&answer->mesh);
  const Result<ExtractStats> stats = (*surface)->Extract(*query, sink);
  if (!stats.ok()) return fail(stats.status());
  Take(*stats, answer);
}

bool AskCpp(const Asked& asked, Answer* answer) {
  FromCpp(asked, asked.question->query, answer);
  return true;
}

bool AskJson(const Asked& asked, Answer* answer) {
  FromCpp(asked, ParseQuery(asked.question->text(), asked.object->diagonal), answer);
  return true;
}

// ---- sources and streams in this process ----

// From a source that answers late and in any order, and whose index grows.
bool AskLate(const Asked& asked, Answer* answer) {
  const auto fail = [&](const Status& status) {
    answer->refused = status.message();
    return true;
  };
  const auto database = Database::Open(asked.world->Store(asked.store).path);
  if (!database.ok()) return fail(database.status());
  auto source = (*database)->OpenObject(asked.name);
  if (!source.ok()) return fail(source.status());
  SurfaceOptions options;
  options.threads = 2;
  if (asked.question->implicit) options.form = RuntimeForm::kImplicit;
  const auto surface = Surface::Open(
      std::make_shared<mtdb::testing::LateSource>(
          std::move(*source), mtdb::testing::LateOptions{.seed = asked.question->text().size()}),
      options);
  if (!surface.ok()) return fail(surface.status());
  TriangleMeshSink sink(&answer->mesh);
  const Result<ExtractStats> stats = (*surface)->Extract(asked.question->query, sink);
  if (!stats.ok()) return fail(stats.status());
  Take(*stats, answer);
  return true;
}

// A field that is the same everywhere, of which nothing is known: all decisions are made again.
Query Unknown(double error) {
  Query query;
  query.threshold = FunctionThreshold([=](const Box3d&) { return error; });
  return query;
}

}  // namespace

MeetsRegion MeetsOf(const Query& query) {
  if (!query.clip || query.region == nullptr) return {};
  return [region = query.region](const Triangle3d& t) { return region->Within(t, 0); };
}

std::vector<Question> MovesTowards(const Asked& asked) {
  constexpr int64_t kMost = 20;
  std::vector<Question> questions;
  for (int64_t i = std::clamp<int64_t>(asked.step->Int("moves", 0), 0, kMost); i > 0; --i) {
    questions.push_back(
        MakeQuestion(MovedBack(*asked.step, i), asked.object->truth, asked.object->diagonal));
  }
  return questions;
}

namespace {

// An update stream, from question to question: sender and client, without a server.
bool AskStream(const Asked& asked, Answer* answer) {
  const auto fail = [&](const Status& status) {
    answer->refused = status.message();
    asked.world->Store(asked.store).streams.erase(asked.name);
    return true;
  };
  if (asked.question->normals) return false;
  auto& stream = asked.world->Store(asked.store).streams[asked.name];
  if (stream == nullptr) {
    const auto database = Database::Open(asked.world->Store(asked.store).path);
    if (!database.ok()) return fail(database.status());
    const auto source = (*database)->OpenObject(asked.name);
    if (!source.ok()) return fail(source.status());
    const auto surface = Surface::Open(*source, {.threads = 2});
    if (!surface.ok()) return fail(surface.status());
    auto session = Session::Open(*surface);
    if (!session.ok()) return fail(session.status());
    const auto base = (*session)->Base();
    if (!base.ok()) return fail(base.status());
    const ObjectRecord& record = (*surface)->record();
    const auto remember = static_cast<uint32_t>(asked.step->Int("remember", 1000));
    const ClientMeshOptions agreed{record.grid, record.attributes, remember};
    stream = std::make_unique<ProcessStream>(std::move(*session), agreed, *base);
    const Status started = stream->decoder.Feed(stream->encoder.start());
    if (!started.ok()) return fail(started);
  }
  // By way of others: what a session knows of the last question must not show in the next answer.
  std::vector<Query> queries;
  if (asked.step->Flag("detour")) {
    queries.push_back(Unknown(asked.step->Number("error", 0.1) * 0.2 * asked.object->diagonal));
  }
  for (const Question& q : MovesTowards(asked)) queries.push_back(q.query);
  queries.push_back(asked.question->query);
  for (const Query& query : queries) {
    std::vector<UpdateBatch> batches;
    const auto update = stream->session->Update(query, &batches);
    if (!update.ok()) return fail(update.status());
    const Bytes bytes = stream->encoder.Encode(batches, MeetsOf(query));
    const size_t portion = asked.step->Flag("detour") ? 7 : bytes.size();
    for (size_t at = 0; at < bytes.size(); at += portion) {
      const Status fed =
          stream->decoder.Feed(ByteSpan(bytes).subspan(at, std::min(portion, bytes.size() - at)));
      if (!fed.ok()) return fail(fed);
    }
    if (!stream->decoder.at_record()) return fail(Corrupt("half a record is left"));
    Take(update->stats, answer);
  }
  TakeClientMesh(stream->decoder.mesh(), answer);
  answer->triangles = answer->mesh.triangles.size();
  return true;
}

struct CHandles {
  mtdb_database* database = nullptr;
  mtdb_object* object = nullptr;
  mtdb_query* query = nullptr;
  mtdb_cut* cut = nullptr;
  ~CHandles() {
    mtdb_free_cut(cut);
    mtdb_free_query(query);
    mtdb_free_object(object);
    mtdb_free_database(database);
  }
};

mtdb_code CAnswer(const Asked& asked, CHandles* c, Answer* answer, mtdb_error* error) {
  mtdb_code code = MTDB_OK;
  mtdb_object_options options;
  MTDB_INIT(options);
  options.threads = 2;
  if (asked.question->implicit) options.form = MTDB_FORM_IMPLICIT;
  const std::string text = asked.question->text();
  mtdb_stats stats;
  MTDB_INIT(stats);
  if ((code =
           mtdb_open(asked.world->Store(asked.store).path.c_str(), nullptr, &c->database, error)) ||
      (code = mtdb_open_object(c->database, asked.name.c_str(), &options, &c->object, error)) ||
      (code = mtdb_create_query(c->object, text.c_str(), &c->query, error)) ||
      (code = mtdb_select(c->object, c->query, nullptr, &c->cut, error)) ||
      (code = mtdb_get_cut_stats(c->cut, &stats, error))) {
    return code;
  }
  TriangleMesh& mesh = answer->mesh;
  mesh.positions.resize(stats.vertices);
  mesh.rows.resize(stats.vertices * stats.row_bytes);
  std::vector<uint32_t> indices(3 * stats.triangles);
  mtdb_arrays arrays;
  MTDB_INIT(arrays);
  arrays.vertex_capacity = stats.vertices;
  arrays.triangle_capacity = stats.triangles;
  arrays.positions = stats.vertices == 0 ? nullptr : &mesh.positions[0].x;
  arrays.indices = indices.data();
  arrays.rows = reinterpret_cast<unsigned char*>(mesh.rows.data());
  if ((code = mtdb_copy_cut(c->cut, &arrays, error))) return code;
  for (size_t i = 0; i < indices.size(); i += 3) {
    mesh.triangles.push_back({indices[i], indices[i + 1], indices[i + 2]});
  }
  mesh.header.attributes = asked.object->layout;
  if (asked.question->normals) {
    for (const char* name : {"nx", "ny", "nz"}) {
      mesh.header.attributes.attributes.push_back({name, ScalarType::kFloat32});
    }
  }
  answer->has_rows = true;
  answer->exact = true;
  answer->triangles = stats.triangles;
  answer->bound = stats.error_bound;
  answer->excess = stats.shortfall_triangles > 0 ? stats.shortfall_excess : 0;
  constexpr const char* kLimits[] = {"accuracy", "triangles", "bytes", "time"};
  answer->limit = kLimits[stats.limit];
  return MTDB_OK;
}

bool AskC(const Asked& asked, Answer* answer) {
  CHandles handles;
  mtdb_error error{};
  if (CAnswer(asked, &handles, answer, &error) != MTDB_OK) answer->refused = error.message;
  return true;
}

// ---- the command line ----

}  // namespace

void ReadAnswerFile(const std::string& path, Answer* answer) {
  const OutputFormat& format = OutputFormatOf(path.substr(path.rfind('.') + 1));
  answer->format = format.extension;
  answer->has_rows = format.rows;
  answer->has_order = format.order;
  answer->lossy = format.lossy;
  // Readers refuse what has no triangle, which is the right answer to some questions.
  const Status status = answer->triangles == 0 ? Status::Ok() : ReadOutput(path, &answer->mesh);
  if (!status.ok()) answer->refused = "what was written cannot be read: " + status.message();
  std::error_code error;
  std::filesystem::remove(path, error);
}

namespace {

double ExcessOf(const nlohmann::json& shortfall) {
  return shortfall.is_object() ? shortfall.value("excess", 0.0) : 0.0;
}

}  // namespace

void ReadAnswerJson(const std::string& text, Answer* answer) {
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object() || !json.contains("error_bound")) {
    answer->refused = "no JSON: " + text;
    return;
  }
  answer->triangles = json.value("triangles", uint64_t{0});
  answer->bound = json.at("error_bound").is_number() ? json.at("error_bound").get<double>() : -1;
  answer->limit = json.value("limit", "");
  answer->excess = ExcessOf(json.value("shortfall", nlohmann::json()));
}

namespace {

// What ended the refinement, from what `extract --verbose` says; "" when it does not.
std::string LimitOfText(const std::string& text) {
  constexpr std::pair<const char*, const char*> kTexts[] = {
      {"; the accuracy that was asked for was reached\n", "accuracy"},
      {"; the limit of triangles ended the refinement\n", "triangles"},
      {"; the limit of bytes to be read ended the refinement\n", "bytes"},
      {"; the limit of time ended the refinement\n", "time"},
  };
  for (const auto& [words, limit] : kTexts) {
    if (text.find(words) != std::string::npos) return limit;
  }
  return "";
}

void FromCommand(const Asked& asked, const Arguments& arguments, const std::string& output,
                 bool json, Answer* answer, const RunOptions& run = {}) {
  const Ran ran = asked.world->Mtdb(arguments, run);
  if (!ran.ok()) {
    answer->refused = ran.err.empty() ? "exit code " + std::to_string(ran.exit_code) : ran.err;
    return;
  }
  if (json) {
    ReadAnswerJson(ran.out, answer);
  } else {
    // "PATH: N triangles, M vertices, error at most E (F of the diagonal)"
    const size_t line = ran.out.find(": ");
    const size_t at = ran.out.find("error at most ");
    const std::string limit = LimitOfText(ran.out);
    if (line == std::string::npos || at == std::string::npos || limit.empty()) {
      answer->refused = "unexpected text: " + ran.out;
      return;
    }
    std::string count = ran.out.substr(line + 2, ran.out.find(' ', line + 2) - line - 2);
    std::erase(count, ',');
    answer->triangles = std::strtoull(count.c_str(), nullptr, 10);
    answer->bound = std::strtod(ran.out.c_str() + at + 14, nullptr) * (1 + 5e-6);
    const size_t unmet = ran.out.find(" are up to ");
    if (unmet != std::string::npos && ran.out.find("NOT MET: ") < unmet) {
      answer->excess = std::strtod(ran.out.c_str() + unmet + 11, nullptr) * (1 + 5e-6);
    } else if (limit != "accuracy" &&
               asked.question->json.value("threshold", nlohmann::json("full")) == "full") {
      answer->excess = answer->bound;  // nobody asked for an error, so the line would say nothing
    }
    answer->limit = limit;
  }
  if (answer->refused.empty()) ReadAnswerFile(output, answer);
}

Arguments Extract(const Asked& asked, const std::string& output) {
  Arguments arguments{"extract", asked.world->PathOf(asked.store, asked.step->Text("by")), output,
                      "--name", asked.name};
  if (asked.question->implicit) arguments.emplace_back("--implicit");
  return arguments;
}

bool AskCommand(const Asked& asked, Answer* answer) {
  if (!asked.question->options) return false;
  const std::string output = NewFile(asked, Format(asked));
  Arguments arguments = Extract(asked, output);
  arguments.insert(arguments.end(), asked.question->options->begin(),
                   asked.question->options->end());
  arguments.emplace_back("--verbose");
  FromCommand(asked, arguments, output, false, answer);
  return true;
}

bool AskCommandJson(const Asked& asked, Answer* answer) {
  const std::string output = NewFile(asked, Format(asked));
  const std::string file = NewFile(asked, "json");
  WriteText(file, asked.question->text());
  Arguments arguments = Extract(asked, output);
  arguments.insert(arguments.end(), {"--query", file, "--json"});
  FromCommand(asked, arguments, output, true, answer);
  return true;
}

}  // namespace

// ---- a packed file ----

std::string Packed(const Asked& asked, Answer* answer) {
  const std::string file = NewFile(asked, "mtdbp");
  const Ran ran =
      asked.world->Mtdb({"pack", asked.world->Store(asked.store).path, file, "--name", asked.name});
  if (ran.ok()) return file;
  answer->refused = "cannot be packed: " + ran.err;
  return "";
}

void FromPlace(const Asked& asked, const std::string& place, const Arguments& more, Answer* answer,
               const RunOptions& run) {
  const std::string output = NewFile(asked, Format(asked));
  const std::string query = NewFile(asked, "json");
  WriteText(query, asked.question->text());
  Arguments arguments{"extract", place, output, "--query", query, "--json", "--name", asked.name};
  if (asked.question->implicit) arguments.emplace_back("--implicit");
  arguments.insert(arguments.end(), more.begin(), more.end());
  FromCommand(asked, arguments, output, true, answer, run);
}

namespace {

bool AskPacked(const Asked& asked, Answer* answer) {
  const std::string file = Packed(asked, answer);
  if (file.empty()) return true;
  FromPlace(asked, file, {}, answer);
  std::filesystem::remove(file);
  return true;
}

// By its URL.
bool AskUrl(const Asked& asked, Answer* answer) {
  const std::string file = Packed(asked, answer);
  if (file.empty()) return true;
  const mtdb::testing::FileServer server(ReadText(file));
  std::filesystem::remove(file);
  FromPlace(asked, server.url(), {}, answer);
  return answer->refused.find("without libcurl") == std::string::npos;
}

// By its URL, while the file is replaced, or its server goes: the answer is right or there is none.
bool AskUnsteadyUrl(const Asked& asked, Answer* answer) {
  const std::string unsteady = asked.step->Text("unsteady");
  if (unsteady.empty()) return false;
  const std::string file = Packed(asked, answer);
  if (file.empty()) return true;
  const int64_t after = asked.step->Int("requests", 1);
  std::string other = ReadText(file);
  std::ranges::for_each(other, [](char& c) { c = static_cast<char>(c ^ 0x55); });
  const mtdb::testing::FileServer server(
      ReadText(file),
      [&](const mtdb::testing::FileRequest& request, mtdb::testing::FileReply* reply) {
        if (unsteady == "silent") reply->headers.erase("ETag");
        if (request.number < after) return;
        if (unsteady == "gone") {
          reply->resets = true;
        } else if (unsteady == "missing") {
          *reply = {};
          reply->status = "404 Not Found";
        } else if (unsteady == "replaced" && request.headers.contains("if-range")) {
          *reply = {};
          reply->status = "200 OK";
          reply->headers["ETag"] = "\"two\"";
          reply->body = other;
        } else {
          reply->body = other.substr(request.first, reply->body.size());
          if (unsteady == "replaced") reply->headers["ETag"] = "\"two\"";
        }
      });
  std::filesystem::remove(file);
  FromPlace(asked, server.url(), {}, answer);
  const bool asked_late = server.requests() > after;
  // Of what came before there may be enough; nothing else is a reason to refuse.
  return answer->refused.empty() ||
         (!asked_late && answer->refused.find("without libcurl") == std::string::npos);
}

}  // namespace

// ---- the server ----

Server* Serving(const Asked& asked) {
  StorePlace& place = asked.world->Store(asked.store);
  if (!place.server) place.server = std::make_unique<Server>(asked.world->options(), place.path);
  return place.server.get();
}

std::string ObjectPath(const Asked& asked) {
  std::string path = "/objects/";
  for (const char c : asked.name) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0) {
      path += c;
    } else {
      constexpr char kHex[] = "0123456789ABCDEF";
      const auto byte = static_cast<unsigned char>(c);
      path += {'%', kHex[byte >> 4], kHex[byte & 15]};
    }
  }
  return path;
}

void FromHttp(const Asked& asked, const std::string& method, const std::string& target,
              const std::string& body, Answer* answer) {
  test::RawConnection connection(Serving(asked)->port());
  if (!connection.connected()) {
    answer->refused = "no connection: " + Serving(asked)->errors();
    return;
  }
  connection.Send(test::RequestText(method, target, body));
  const test::HttpAnswer got = connection.ReceiveAnswer();
  if (got.status != 200) {
    answer->refused = "status " + std::to_string(got.status) + ": " + got.body;
    return;
  }
  answer->triangles = std::strtoull(got.header("X-Mtdb-Triangles").c_str(), nullptr, 10);
  answer->bound = std::strtod(got.header("X-Mtdb-Error-Bound").c_str(), nullptr) * (1 + 1e-6);
  answer->limit = got.header("X-Mtdb-Limit");
  answer->excess = ExcessOf(nlohmann::json::parse(got.header("X-Mtdb-Shortfall"), nullptr, false));
  const std::string file = NewFile(asked, Format(asked));
  WriteText(file, got.body);
  ReadAnswerFile(file, answer);
}

namespace {

bool AskPost(const Asked& asked, Answer* answer) {
  // A query in the body and another one in the parameters is a mistake that has to be told.
  test::RawConnection wrong(Serving(asked)->port());
  wrong.Send(test::RequestText("POST", ObjectPath(asked) + "/mesh?format=ply&error=1",
                               asked.question->text()));
  const int status = wrong.ReceiveAnswer().status;
  if (status != 400) {
    asked.world->Fault("post: parameters beside a body are not refused", std::to_string(status));
  }
  FromHttp(asked, "POST", ObjectPath(asked) + "/mesh?format=" + Format(asked),
           asked.question->text(), answer);
  return true;
}

bool AskGet(const Asked& asked, Answer* answer) {
  if (!asked.question->options) return false;
  std::string target = ObjectPath(asked) + "/mesh?format=" + Format(asked);
  const Arguments& options = *asked.question->options;
  for (size_t i = 0; i < options.size(); ++i) {
    std::string option = options[i].substr(2);
    if (i + 1 < options.size() && !options[i + 1].starts_with("--")) option += "=" + options[++i];
    for (const char c : "&" + option) target += c == '%' ? "%25" : std::string(1, c);
  }
  FromHttp(asked, "GET", target, "", answer);
  return true;
}

bool AskFetch(const Asked& asked, Answer* answer) {
  const std::string output = NewFile(asked, Format(asked));
  const std::string file = NewFile(asked, "json");
  WriteText(file, asked.question->text());
  FromCommand(asked,
              {"fetch", Serving(asked)->url() + ObjectPath(asked), output, "--query", file,
               "--json", "--timeout", "900"},
              output, true, answer);
  return true;
}

bool AskFetchLibrary(const Asked& asked, Answer* answer) {
  const std::string file = NewFile(asked, Format(asked));
  std::string bytes;
  FetchOptions options;
  options.name = asked.name;
  options.format = Format(asked);
  options.timeout_seconds = 900;
  const auto got = FetchMesh(Serving(asked)->url(), asked.question->text(), options,
                             [&](std::string_view piece) {
                               bytes += piece;
                               return Status::Ok();
                             });
  if (!got.ok()) {
    answer->refused = got.status().message();
    return true;
  }
  answer->triangles = got->triangles;
  answer->bound = got->error_bound * (1 + 1e-6);
  answer->excess = got->shortfall.excess;
  answer->limit = got->limit;
  WriteText(file, bytes);
  ReadAnswerFile(file, answer);
  return true;
}

// One session for each object, from question to question.
bool AskSession(const Asked& asked, Answer* answer) {
  if (asked.question->normals) return false;
  auto& session = asked.world->Store(asked.store).sessions[asked.name];
  if (session == nullptr || !session->connected()) {
    RemoteSessionOptions options;
    options.timeout_seconds = 900;
    options.remembered_vertices = static_cast<uint32_t>(asked.step->Int("remember", 1000));
    auto opened = RemoteSession::Open(Serving(asked)->url() + ObjectPath(asked), options);
    if (!opened.ok()) {
      answer->refused = opened.status().message();
      return true;
    }
    session = std::move(*opened);
  }
  std::vector<std::string> texts;
  for (const Question& q : MovesTowards(asked)) texts.push_back(q.text());
  texts.push_back(asked.question->text());
  Result<RemoteUpdate> update = session->Update(texts.front());
  for (size_t i = 1; update.ok() && i < texts.size(); ++i) update = session->Update(texts[i]);
  if (!update.ok()) {
    answer->refused = update.status().message();
    session.reset();
    return true;
  }
  TriangleMeshSink sink(&answer->mesh);
  const Status sent = session->SendMesh(sink);
  if (!sent.ok()) answer->refused = sent.message();
  answer->has_rows = true;
  answer->exact = true;
  answer->any_bound = true;
  answer->triangles = update->triangles;
  answer->bound = update->error_bound * (1 + 1e-6);
  answer->excess = update->shortfall.excess;
  answer->limit = update->limit;
  return true;
}

// A session by frames of our own: messages in parts, pings between them, bytes in portions.
bool AskFrames(const Asked& asked, Answer* answer) {
  if (asked.question->normals) return false;
  const auto fail = [&](const std::string& why) {
    answer->refused = why;
    return true;
  };
  const std::string remember = asked.step->Text("remember", "1000");
  test::RawSession session(Serving(asked)->port(),
                           ObjectPath(asked) + "/session?remember=" + remember);
  if (session.status() != 101) return fail("status " + std::to_string(session.status()));
  std::vector<std::string> queries{R"({"threshold": {"relative": 0.02}})"};
  for (const Question& q : MovesTowards(asked)) queries.push_back(q.text());
  queries.push_back(asked.question->text());
  UpdateDecoder decoder;
  for (size_t id = 0; id < queries.size(); ++id) {
    const std::string message = test::QueryMessage(id + 1, queries[id]);
    const size_t part = 1 + message.size() / (2 + id);
    for (size_t at = 0; at < message.size(); at += part) {
      const bool last = at + part >= message.size();
      session.Send(test::FrameText((last ? 0x80 : 0) | (at == 0 ? test::kText : 0),
                                   message.substr(at, part)));
      if (!last) session.Send(test::FrameText(0x80 | test::kPing, "are you there?"));
    }
    nlohmann::json done;
    size_t pongs = 0;
    while (!done.is_object()) {
      const std::optional<test::Frame> frame = session.ReceiveFrame();
      if (!frame) return fail("the server closes the connection");
      if (frame->opcode == test::kCloseFrame) {
        return fail("the server closes: " + std::to_string(frame->close_code()) + " " +
                    frame->payload.substr(std::min<size_t>(2, frame->payload.size())));
      }
      if (frame->opcode == test::kPong) ++pongs;
      if (frame->opcode == test::kBinary) {
        const ByteSpan bytes = AsBytes(frame->payload);
        if (bytes.empty()) return fail("an empty binary message");
        for (size_t at = 0; at < bytes.size(); at += 1000) {
          const Status fed =
              decoder.Feed(bytes.subspan(at, std::min<size_t>(1000, bytes.size() - at)));
          if (!fed.ok()) return fail(fed.message());
        }
        if (!decoder.at_record()) return fail("a message with a part of a record");
      }
      if (frame->opcode != test::kText) continue;
      const auto json = nlohmann::json::parse(frame->payload, nullptr, false);
      if (json.contains("hello")) continue;
      if (!json.contains("done") || json.value("id", size_t{0}) != id + 1) {
        return fail("no answer: " + frame->payload);
      }
      done = json.at("done");
    }
    if (pongs == 0) return fail("no pong before the answer");
    ReadAnswerJson(done.dump(), answer);
  }
  answer->bound *= 1 + 1e-6;
  TakeClientMesh(decoder.mesh(), answer);
  if (asked.question->clip) answer->triangles = answer->mesh.triangles.size();
  session.Send(test::FrameText(0x80 | test::kCloseFrame, std::string("\x03\xe8", 2)));
  const int code = session.ReceiveClose();
  if (code != 1000) return fail("closes with " + std::to_string(code) + ", not 1000");
  return true;
}

// By the program, in a session of its own that comes from another query.
bool AskFollow(const Asked& asked, Answer* answer) {
  if (asked.question->normals) return false;
  const std::string path = NewFile(asked, "jsonl");
  const std::string output = NewFile(asked, "%d.ply");
  // From a coarse mesh, or, where an error is asked for, in steps from twice that.
  Json before{{"threshold", {{"relative", 0.02}}}}, last = asked.question->json;
  size_t steps = 1;
  if (last.contains("threshold") && last["threshold"].is_number() && asked.step->Flag("detour")) {
    before = last;
    before["threshold"] = 2 * last["threshold"].get<double>();
    last["steps"] = steps = 3;
  }
  WriteText(path, before.dump() + "\n" + last.dump() + "\n");
  const Ran ran = asked.world->Mtdb({"follow", Serving(asked)->url() + ObjectPath(asked), "--path",
                                     path, "--output", output, "--timeout", "900", "--json"});
  const auto json = nlohmann::json::parse(ran.out, nullptr, false);
  if (!ran.ok() || !json.is_object() || json.value("steps", Json::array()).size() != 1 + steps) {
    answer->refused = ran.err.empty() ? "no JSON: " + ran.out : ran.err;
    return true;
  }
  ReadAnswerJson(json.at("steps").at(steps).dump(), answer);
  answer->any_bound = true;
  std::string file = output;
  file.replace(file.find("%d"), 2, std::to_string(1 + steps));
  ReadAnswerFile(file, answer);
  return true;
}

}  // namespace

const std::vector<NamedWay>& Ways() {
  static const std::vector<NamedWay> kWays = {
      {"c++", AskCpp},
      {"json", AskJson},
      {"c", AskC},
      {"command", AskCommand},
      {"command-json", AskCommandJson},
      {"packed", AskPacked},
      {"url", AskUrl},
      {"url-unsteady", AskUnsteadyUrl},
      // While a server that has just come up has nothing in memory.
      {"available-json", AskAvailableJson},
      {"get", AskGet},
      {"post", AskPost},
      {"fetch", AskFetch},
      {"fetch-library", AskFetchLibrary},
      {"late", AskLate},
      {"stream", AskStream},
      {"available", AskAvailable},
      {"available-stream", AskAvailableStream},
      {"python", AskPython},
      {"pipe", AskPipe},
      {"session", AskSession},
      {"frames", AskFrames},
      {"follow", AskFollow},
      {"packed-served", AskServedPacked},
      {"url-kept", AskKept},
      {"small-cache", AskSmallCache},
  };
  return kWays;
}

}  // namespace mtdb::everything
