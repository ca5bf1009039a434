// SPDX-License-Identifier: Apache-2.0
// Packed files over HTTP, from servers that answer rightly, wrongly, late or not at all: what was
// packed, or an error that says why, and never anything else.
#include "store/carriers/http_ranges.h"

#include <catch2/catch.hpp>
#include <cstdlib>
#include <random>

#include "store/base/wait_scope.h"
#include "store/carriers/http_url.h"
#include "store/packed/packed_reader.h"
#include "store/packed_file.h"
#include "tests/store/store_fixture.h"
#include "tests/support/file_server.h"

namespace mtdb::test {

using namespace internal;
using testing::FileReply;
using testing::FileRequest;
using testing::FileServer;

namespace {

#if MTDB_TEST_HTTP

constexpr size_t kHead = 64 << 10;  // what the first request asks for

struct Packed {
  SyntheticObject object = MakeObject({.seed = 4, .clusters = 300, .max_payload = 4000});
  std::string file;
  Packed() {
    const TempDir dir;
    const auto store = OpenWritable(dir.File("store.mtdb"));
    REQUIRE(WriteObject(*store, "a", object).ok());
    const std::shared_ptr<ClusterSource> source = store->OpenObject("a").value();
    REQUIRE(PackObjects({&source, 1}, [&](ByteSpan bytes) {
              file += AsString(bytes);
              return Status::Ok();
            }).ok());
    REQUIRE(file.size() > 4 * kHead);
  }
};
const Packed& ThePacked() {
  static const Packed kPacked;
  return kPacked;
}

HttpOptions Impatient() {
  return {.tries = 3,
          .first_wait = 0.01,
          .most_wait = 0.05,
          .stall_seconds = 1,
          .connect_seconds = 5,
          .parallel = 6};
}

// All of the file's units, as a query asks for them. kInvalidArgument: not what was written.
Status ReadAll(const std::string& url, const HttpOptions& options = Impatient()) {
  MTDB_ASSIGN_OR_RETURN(std::shared_ptr<RangeReader> ranges, OpenHttpRanges(url, options));
  MTDB_ASSIGN_OR_RETURN(const auto file, PackedFile::Open(ranges));
  MTDB_ASSIGN_OR_RETURN(const auto source, PackedSource::Open(file, file->objects()[0], false));
  const SyntheticObject& object = ThePacked().object;
  for (uint32_t end = source->index().unit_count(); end > 0;) {
    std::vector<UnitId> units;
    for (; end > 0 && units.size() < 40; --end) units.push_back(end - 1);
    MTDB_RETURN_IF_ERROR(ReadUnits(*source, units, [&](UnitId u, const Bytes& payload) {
      return payload == object.units[u].payload ? Status::Ok() : InvalidArgument("differs");
    }));
  }
  return Status::Ok();
}

void Fails(const FileServer::Behaviour& behaviour, StatusCode code, const std::string& words) {
  const FileServer server(ThePacked().file, behaviour);
  const Status status = ReadAll(server.url());
  INFO(status.message());
  CHECK(status.code() == code);
  CHECK_THAT(status.message(), Catch::Contains(words));
  CHECK_THAT(status.message(), Catch::StartsWith(server.url() + ": "));
}

void Works(const FileServer::Behaviour& behaviour) {
  const FileServer server(ThePacked().file, behaviour);
  CHECK(ReadAll(server.url()).message() == "");
}

// A behaviour from the second request on: the first one has opened the file.
FileServer::Behaviour Later(const FileServer::Behaviour& behaviour) {
  return [behaviour](const FileRequest& request, FileReply* reply) {
    if (request.number > 0) behaviour(request, reply);
  };
}
FileServer::Behaviour Once(const FileServer::Behaviour& behaviour) {
  return [behaviour](const FileRequest& request, FileReply* reply) {
    if (request.number == 1) behaviour(request, reply);
  };
}
FileServer::Behaviour Answers(const std::string& status) {
  return [status](const FileRequest&, FileReply* reply) {
    reply->status = status;
    reply->headers.erase("Content-Range");
    reply->body = "sorry";
  };
}

}  // namespace

TEST_CASE("a packed file is read over HTTP in few requests", "[http]") {
  const FileServer server(ThePacked().file);
  CHECK(ReadAll(server.url()).message() == "");
  const auto units = static_cast<int>(ThePacked().object.units.size());
  CHECK(server.requests() < units / 4);
  CHECK(server.bytes_sent() < 2 * ThePacked().file.size());
}

TEST_CASE("servers that a file cannot be read from are told from each other", "[http]") {
  Fails(Answers("404 Not Found"), StatusCode::kNotFound, "404");
  Fails(Answers("410 Gone"), StatusCode::kNotFound, "410");
  Fails(Answers("403 Forbidden"), StatusCode::kIoError, "no access");
  Fails(Answers("401 Unauthorized"), StatusCode::kIoError, "no access");
  Fails(Answers("416 Range Not Satisfiable"), StatusCode::kCorrupt, "416");
  Fails(Answers("204 No Content"), StatusCode::kIoError, "204");
  Fails(Answers("500 Internal Server Error"), StatusCode::kIoError, "the last of 3 tries");
  Fails(Answers("429 Too Many Requests"), StatusCode::kIoError, "429");
  Fails(
      [](const FileRequest&, FileReply* reply) {
        reply->status = "200 OK";
        reply->headers.erase("Content-Range");
        reply->body = ThePacked().file;
      },
      StatusCode::kUnsupported, "ignores Range");
  Fails([](const FileRequest&, FileReply* reply) { reply->headers["Content-Encoding"] = "gzip"; },
        StatusCode::kUnsupported, "compression");
  Fails([](const FileRequest&, FileReply* reply) { reply->headers.erase("Content-Range"); },
        StatusCode::kIoError, "Content-Range");
  Fails([](const FileRequest&,
           FileReply* reply) { reply->headers["Content-Range"] = "bytes 0-99/\x1b[31m"; },
        StatusCode::kIoError, "'bytes 0-99/?[31m'");
  Fails([](const FileRequest&, FileReply* reply) { reply->raw = "SSH-2.0-OpenSSH\r\n\r\n"; },
        StatusCode::kIoError, "");
  Fails([](const FileRequest&, FileReply* reply) { reply->raw = "HTTP/1.1 206\r\n\r\n"; },
        StatusCode::kIoError, "Content-Range");
  Fails(
      [](const FileRequest&, FileReply* reply) {
        reply->raw = "HTTP/1.1 206 OK\r\n";
        while (reply->raw.size() < (4 << 20))
          reply->raw += "X-Header: " + std::string(90, 'x') + "\r\n";
      },
      StatusCode::kIoError, "");
}

TEST_CASE("an answer that is not the range that was asked for is refused", "[http]") {
  Fails(Later([](const FileRequest&, FileReply* reply) {
          reply->headers["Content-Range"] = "bytes 0-" + std::to_string(reply->body.size() - 1) +
                                            "/" + std::to_string(ThePacked().file.size());
        }),
        StatusCode::kIoError, "asked for");
  Fails(Later([](const FileRequest&, FileReply* reply) { reply->body += "more"; }),
        StatusCode::kIoError, "asked for");
  Fails(Later([](const FileRequest&, FileReply* reply) { reply->body.pop_back(); }),
        StatusCode::kIoError, "came");
  Fails(Later([](const FileRequest&, FileReply* reply) { reply->sent = 10; }), StatusCode::kIoError,
        "the last of 3 tries");
  Fails(Later([](const FileRequest&, FileReply* reply) { reply->body[0] ^= 1; }),
        StatusCode::kCorrupt, "");
}

TEST_CASE("a file that changes under way is noticed", "[http]") {
  const std::string changed = "the file changed";
  Fails(Later([](const FileRequest&, FileReply* reply) { reply->headers["ETag"] = "\"two\""; }),
        StatusCode::kCorrupt, changed);
  // As a server answers to If-Range.
  Fails(Later([](const FileRequest&, FileReply* reply) {
          reply->status = "200 OK";
          reply->headers = {{"ETag", "\"two\""}};
          reply->body = "another file";
        }),
        StatusCode::kCorrupt, changed);
  Fails(Later([](const FileRequest& request, FileReply* reply) {
          reply->headers = {{"Content-Range", "bytes " + std::to_string(request.first) + "-" +
                                                  std::to_string(request.last) + "/99999999"}};
        }),
        StatusCode::kCorrupt, changed);
  Fails(Later(Answers("416 Range Not Satisfiable")), StatusCode::kCorrupt, changed);
  Fails(Later(Answers("412 Precondition Failed")), StatusCode::kCorrupt, changed);
  Fails(Later(Answers("404 Not Found")), StatusCode::kNotFound, "404");
  // Without a word from the server, by its bytes.
  Fails(
      [](const FileRequest& request, FileReply* reply) {
        reply->headers.erase("ETag");
        if (request.number > 0) reply->body.assign(reply->body.size(), 'x');
      },
      StatusCode::kCorrupt, "checksum");
}

TEST_CASE("what is transient is tried again", "[http]") {
  for (const char* status : {"429 Slow Down", "500 Oh", "502 Oh", "503 Busy", "504 Oh"}) {
    Works(Once(Answers(status)));
  }
  Works(Once([](const FileRequest&, FileReply* reply) { reply->resets = true; }));
  Works(Once([](const FileRequest&, FileReply* reply) { reply->sent = 100; }));
  Works(Once([](const FileRequest&, FileReply* reply) { reply->body.resize(100); }));
  Works(Once([](const FileRequest&, FileReply* reply) { reply->hangs = true; }));
  Works(Once([](const FileRequest&, FileReply* reply) {
    reply->status = "503 Busy";
    reply->headers["Retry-After"] = "1000000";  // no longer than a reader wants to wait
  }));
  Works([](const FileRequest& request, FileReply* reply) {
    if (request.number == 0) reply->resets = true;
  });
  Fails([](const FileRequest&, FileReply* reply) { reply->hangs = true; }, StatusCode::kIoError,
        "the last of 3 tries");
}

TEST_CASE("redirects are followed, but not for ever and not anywhere", "[http]") {
  Works([](const FileRequest& request, FileReply* reply) {
    if (request.target != "/file.mtdbp") return;
    reply->status = "302 Found";
    reply->headers = {{"Location", "/elsewhere"}, {"ETag", "\"redirect\""}};
    reply->body = "over there";
  });
  const auto redirect_to = [](const std::string& where) {
    return [where](const FileRequest&, FileReply* reply) {
      reply->status = "302 Found";
      reply->headers = {{"Location", where}};
    };
  };
  Fails(redirect_to("/file.mtdbp"), StatusCode::kIoError, "redirect");
  Fails(redirect_to("ftp://127.0.0.1/x"), StatusCode::kIoError, "");
  Fails(redirect_to("file:///etc/passwd"), StatusCode::kIoError, "");
}

TEST_CASE("requests to an object store are signed when there are keys", "[http]") {
  std::map<std::string, std::string> headers;
  std::string target;
  const FileServer server(ThePacked().file, [&](const FileRequest& request, FileReply*) {
    headers = request.headers;
    target = request.target;
  });
  const std::string endpoint = "http://127.0.0.1:" + std::to_string(server.port());
  ::setenv("AWS_ENDPOINT_URL", endpoint.c_str(), 1);
  CHECK(ReadAll("s3://bucket/a/file.mtdbp").message() == "");
  CHECK(target == "/bucket/a/file.mtdbp");
  CHECK(!headers.contains("authorization"));
  ::setenv("AWS_ACCESS_KEY_ID", "me", 1);
  ::setenv("AWS_SECRET_ACCESS_KEY", "hidden", 1);
  ::setenv("AWS_SESSION_TOKEN", "token", 1);
  CHECK(ReadAll("s3://bucket/a/file.mtdbp").message() == "");
  CHECK_THAT(headers["authorization"], Catch::Contains("AWS4-HMAC-SHA256 Credential=me/") &&
                                           Catch::Contains("/us-east-1/s3/aws4_request"));
  CHECK(headers["x-amz-content-sha256"].size() == 64);
  CHECK(headers["x-amz-security-token"] == "token");
  // Another host learns nothing.
  headers.clear();
  const FileServer sends_away(ThePacked().file, [&](const FileRequest&, FileReply* reply) {
    reply->status = "307 Temporary Redirect";
    reply->headers = {{"Location", server.url()}};
  });
  ::setenv("AWS_ENDPOINT_URL", ("http://127.0.0.1:" + std::to_string(sends_away.port())).c_str(),
           1);
  const Status away = ReadAll("s3://bucket/a/file.mtdbp");
  CHECK(away.code() == StatusCode::kIoError);
  CHECK_THAT(away.message(), Catch::Contains("307") && Catch::Contains("redirect"));
  CHECK(headers.empty());
  for (const char* name :
       {"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_ENDPOINT_URL"}) {
    ::unsetenv(name);
  }
}

TEST_CASE("where nobody listens there is an error", "[http]") {
  std::string url;
  { url = FileServer("x").url(); }
  const Status status = ReadAll(url);
  CHECK(status.code() == StatusCode::kIoError);
  CHECK_THAT(status.message(), Catch::StartsWith(url + ": "));
  CHECK(ReadAll("http://no-such-host.invalid/x").code() == StatusCode::kIoError);
  CHECK(ReadAll("http:///x").code() == StatusCode::kIoError);
}

TEST_CASE("any mixture of failures gives what was packed or an error", "[http]") {
  int read = 0;
  for (unsigned seed = 0; seed < 12; ++seed) {
    std::mt19937 random(seed);
    const unsigned good = 97 - 3 * (seed % 4);
    const FileServer server(ThePacked().file, [&](const FileRequest&, FileReply* reply) {
      if (random() % 100 < good) return;
      switch (random() % 8) {
        case 0: reply->resets = true; break;
        case 1: reply->sent = random() % (reply->body.size() + 1); break;
        case 2: Answers("503 Busy")({}, reply); break;
        case 3: reply->body.resize(random() % (reply->body.size() + 1)); break;
        case 4: reply->body[random() % reply->body.size()] ^= 4; break;
        case 5: reply->pause_ms = static_cast<int>(random() % 30); break;
        case 6: reply->headers["ETag"] = "\"two\""; break;
        default: reply->raw = "HTTP/1.1 206 What\r\nContent-Range: nonsense\r\n\r\nhm"; break;
      }
    });
    const Status status = ReadAll(server.url());
    INFO(status.message());
    CHECK(status.code() != StatusCode::kInvalidArgument);
    read += status.ok() ? 1 : 0;
  }
  CHECK(read > 0);
}

TEST_CASE("a reader that goes while requests are under way leaves nothing behind", "[http]") {
  for (int i = 0; i < 20; ++i) {
    const FileServer server(ThePacked().file, Later([&](const FileRequest&, FileReply* reply) {
                              if (i % 2 == 0) reply->pause_ms = i;
                              if (i % 5 == 0) reply->hangs = true;
                            }));
    std::shared_ptr<RangeReader> ranges = OpenHttpRanges(server.url(), Impatient()).value();
    std::atomic<int> answers{0};
    std::vector<RangeReader::Ticket> tickets;
    for (uint64_t at = kHead; at < 3 * kHead; at += 1000) {
      tickets.push_back(ranges->Read({at, 1000}, [&](const Result<Bytes>&) { ++answers; }));
    }
    for (size_t t = 0; t < tickets.size(); t += 3) ranges->Cancel(tickets[t]);
    const auto asked = static_cast<int>(tickets.size());
    ranges.reset();
    CHECK(answers == asked);
  }
}

#endif

TEST_CASE("what a URL asks for, and what messages show of it", "[http]") {
  const auto plain = PlaceOfUrl("https://me:secret@example.org:8080/a/b.mtdbp?token=secret#x");
  REQUIRE(plain.ok());
  CHECK(plain->shown == "https://example.org:8080/a/b.mtdbp");
  CHECK(plain->signature_scope.empty());
  CHECK(PlaceOfUrl("http://me@h").value().shown == "http://h");
  CHECK(!PlaceOfUrl("http://example.org/a b").ok());
  CHECK(!PlaceOfUrl("http://example.org/a\r\nX: y").ok());
  for (const char* name :
       {"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_REGION",
        "AWS_DEFAULT_REGION", "AWS_ENDPOINT_URL", "AWS_ENDPOINT_URL_S3"}) {
    ::unsetenv(name);
  }
  CHECK(PlaceOfUrl("s3://bucket/a/b c.mtdbp").ok() == false);
  CHECK(PlaceOfUrl("s3://bucket/a/b+c.mtdbp").value().url ==
        "https://bucket.s3.us-east-1.amazonaws.com/a/b%2Bc.mtdbp");
  CHECK(!PlaceOfUrl("s3://bucket").ok());
  CHECK(!PlaceOfUrl("s3:///key").ok());
  CHECK(!PlaceOfUrl("s3://bucket/").ok());
  CHECK(!PlaceOfUrl("s3://evil.org:80/x").ok());
  ::setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9000/", 1);
  ::setenv("AWS_REGION", "eu-west-3", 1);
  CHECK(!PlaceOfUrl("s3://bucket/key").value().url.empty());
  ::setenv("AWS_ACCESS_KEY_ID", "id", 1);
  CHECK(!PlaceOfUrl("s3://bucket/key").ok());
  ::setenv("AWS_SECRET_ACCESS_KEY", "hidden", 1);
  const auto signed_one = PlaceOfUrl("s3://bucket/key");
  REQUIRE(signed_one.ok());
  CHECK(signed_one->url == "http://127.0.0.1:9000/bucket/key");
  CHECK(signed_one->shown == "s3://bucket/key");
  CHECK(signed_one->signature_scope == "aws:amz:eu-west-3:s3");
  CHECK(signed_one->credentials == "id:hidden");
  for (const char* name :
       {"AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_REGION", "AWS_ENDPOINT_URL"}) {
    ::unsetenv(name);
  }
}

#if MTDB_TEST_HTTP

TEST_CASE("a server that trickles, or never comes to its answer, is given up", "[http]") {
  const auto raw = [](const std::string& first, const std::string& again) -> FileServer::Behaviour {
    return [first, again](const FileRequest& request, FileReply* reply) {
      reply->raw = first;
      reply->again = again;
      if (first.find("206") == first.npos) return;
      reply->raw +=
          "ETag: \"one\"\r\nContent-Length: " + std::to_string(request.last - request.first + 1) +
          "\r\nContent-Range: bytes " + std::to_string(request.first) + "-" +
          std::to_string(request.last) + "/" + std::to_string(ThePacked().file.size()) + "\r\n\r\n";
    };
  };
  HttpOptions options = Impatient();
  options.request_seconds = 0.5;
  options.least_rate = 1 << 20;
  for (const FileServer::Behaviour& behaviour :
       {raw("HTTP/1.1 206 Partial Content\r\n", "x"),
        raw("HTTP/1.1 100 Continue\r\n\r\n", "HTTP/1.1 100 Continue\r\n\r\n"),
        raw("HTTP/1.1 102 Processing\r\n\r\n", "HTTP/1.1 102 Processing\r\n\r\n"),
        raw("HTTP/1.1 302 Found\r\nLocation: /x\r\nContent-Length: 999999\r\n\r\n", "x"),
        raw("HTTP/1.1 206 Partial Content\r\nX: ", "x"), raw("H", "")}) {
    for (const bool later : {false, true}) {
      const FileServer server(ThePacked().file, later ? Later(behaviour) : behaviour);
      const Status status = ReadAll(server.url(), options);
      INFO(status.message());
      CHECK(status.code() == StatusCode::kIoError);
      CHECK_THAT(status.message(), Catch::StartsWith(server.url() + ": "));
    }
  }
}

TEST_CASE("who does not want to wait any more for a server need not", "[http]") {
  const FileServer server(ThePacked().file,
                          Later([](const FileRequest&, FileReply* reply) { reply->hangs = true; }));
  // Would wait for a minute.
  HttpOptions options = Impatient();
  options.stall_seconds = 60;
  std::shared_ptr<RangeReader> ranges = OpenHttpRanges(server.url(), options).value();
  int looks = 0;
  {
    const WaitScope scope([&] { return ++looks > 3; });
    CHECK(ReadRange(*ranges, {kHead, 1000}).status().code() == StatusCode::kCancelled);
    const auto file = PackedFile::Open(ranges);
    REQUIRE(file.ok());
    const auto source = PackedSource::Open(*file, (*file)->objects()[0], false);
    REQUIRE(source.ok());
    const UnitId last = (*source)->index().unit_count() - 1;
    const auto receive = [](UnitId, const Bytes&) { return Status::Ok(); };
    CHECK(ReadUnits(**source, {&last, 1}, receive).code() == StatusCode::kCancelled);
  }
  CHECK(looks > 3);
}

#endif

TEST_CASE("no key of a bucket leads out of it", "[http]") {
  for (const std::string key :
       {"../x", "a/../x", "a/..", ".", "./x", "a/./x", "%2e%2e/x", "%2E./x", "a/%2e%2E", "a%2f../x",
        "a%2F%2e%2e%2fx", "%252e%252e/x", "%25252e./x", "a\\..\\x", "%2e", "a/%5c../x"}) {
    INFO(key);
    CHECK(PlaceOfUrl("s3://bucket/" + key).status().code() == StatusCode::kInvalidArgument);
  }
  CHECK(!PlaceOfUrl("s3://../x").ok());
  CHECK(!PlaceOfUrl("s3://./x").ok());
  for (const std::string key : {"a..b/x", "...", "..a", "a.", "a//x", "%2", "%", "%2e%2ea"}) {
    INFO(key);
    CHECK(PlaceOfUrl("s3://bucket/" + key).ok());
  }
}

TEST_CASE("errors about places do not tell what opens them", "[http]") {
  const std::string secret = "S3cr3t";
  ::setenv("AWS_ENDPOINT_URL", ("user:" + secret + "@host:9000").c_str(), 1);
  CHECK_THAT(PlaceOfUrl("s3://bucket/key").status().message(), !Catch::Contains(secret));
  ::unsetenv("AWS_ENDPOINT_URL");
  for (const std::string& url :
       {"s3://user:" + secret + "@bucket/key", "s3://b/../x?X-Amz-Signature=" + secret,
        "s3://b?sig=" + secret, "s3://user:" + secret + "@"}) {
    CHECK_THAT(PlaceOfUrl(url).status().message(), !Catch::Contains(secret));
    CHECK_THAT(Database::Open(url).status().message(), !Catch::Contains(secret));
    CHECK_THAT(Database::Open(url, {.writable = true}).status().message(),
               !Catch::Contains(secret));
  }
  CHECK(PlaceOfUrl("s3://b/k?sig=" + secret).value().shown == "s3://b/k");
}

}  // namespace mtdb::test
