// SPDX-License-Identifier: Apache-2.0
// The client library against servers that answer wrongly, endlessly, or a little at a time: each
// exchange ends, with an error that says where.
#include <algorithm>
#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <catch2/catch.hpp>
#include <functional>
#include <vector>

#include "codecs/coding/rans.h"
#include "store/base/hash.h"
#include "tests/support/client_mesh_check.h"
#include "tests/support/raw_session.h"
#include "tests/tools/cli_testing.h"
#include "tests/tools/http_testing.h"
#include "tools/client/client.h"
#include "tools/client/network.h"

namespace mtdb::test {
namespace {

constexpr double kShort = 0.3;  // seconds, where the timeout is what ends an exchange
constexpr double kLong = 60;    // where it is not

constexpr const char* kQuery = R"({"threshold": 0.5})";

// Sends `bytes`; false when the client does not take them.
using Say = std::function<bool(const std::string& bytes)>;

// Takes connections one after the other. `say` is given to `answer` after the head of a request;
// what `answer` returns from closes the connection. A session's upgrade is accepted before.
class HostileServer {
 public:
  using Answer = std::function<void(const Say&)>;
  HostileServer(bool session, Answer answer)
      : acceptor_(io_, Tcp::endpoint(asio::ip::address_v4::loopback(), 0)),
        thread_([this, session, answer = std::move(answer)] { Run(session, answer); }) {}
  ~HostileServer() {
    stop_ = true;
    RawConnection wake(acceptor_.local_endpoint().port());
    wake.Close();
    thread_.join();
  }
  std::string url() const {
    return "http://127.0.0.1:" + std::to_string(acceptor_.local_endpoint().port()) + "/objects/a";
  }

 private:
  void Run(bool session, const Answer& answer) {
    while (true) {
      Tcp::socket socket(io_);
      ErrorCode error;
      acceptor_.accept(socket, error);
      if (stop_) return;
      if (session) {
        websocket::stream<Tcp::socket&> upgrade(socket);
        upgrade.accept(error);
      } else {
        char block[4096];
        socket.read_some(asio::buffer(block), error);
      }
      const Say say = [&](const std::string& bytes) {
        ErrorCode failed;
        asio::write(socket, asio::buffer(bytes), failed);
        return !failed && !stop_;
      };
      if (!error) answer(say);
      // Closing with bytes unread would be a reset, which could overtake the answer.
      socket.shutdown(Tcp::socket::shutdown_send, error);
      char rest[4096];
      while (!error) socket.read_some(asio::buffer(rest), error);
    }
  }

  asio::io_context io_;
  Tcp::acceptor acceptor_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

void Pause() { std::this_thread::sleep_for(std::chrono::milliseconds(10)); }

std::string Binary(const std::string& payload) { return FrameText(0x80 | kBinary, payload, false); }
std::string Text(const std::string& payload) { return FrameText(0x80 | kText, payload, false); }

// Records of the update stream that hold no update. The model of the only decision in them adapts:
// after some thousand they are all the same.
std::string EmptyRecords(int count, AdaptiveBit* more) {
  ByteWriter out;
  for (int i = 0; i < count; ++i) {
    RansEncoder coder;
    coder.Bit(*more, false);
    const Bytes record = coder.Finish();
    out.PutVarint(record.size());
    out.Put<uint32_t>(static_cast<uint32_t>(Hash64(record)));
    out.PutBytes(record);
  }
  return std::string(AsString(out.bytes()));
}

// What `mtdb serve` answers.
struct Recording {
  std::string mesh;                   // all of an HTTP answer
  std::vector<std::string> messages;  // of a session with one query, as frames
  std::string all() const {
    std::string text;
    for (const std::string& message : messages) text += message;
    return text;
  }
  // Hello and base mesh.
  std::string start() const { return messages[0] + messages[1]; }
};
const Recording& TheRecording() {
  static const Recording kRecording = [] {
    Recording recording;
    const ServerProcess server(SmallExample().store);
    RawConnection connection(server.port());
    connection.Send(RequestText("POST", "/objects/sculpture/mesh?format=ply",
                                R"({"threshold": "coarsest"})", "Connection: close\r\n"));
    recording.mesh = connection.ReceiveAll();
    RawSession session(server.port(), "/objects/sculpture/session?triangles=10000");
    const auto take = [&] {
      const std::optional<Frame> frame = session.ReceiveFrame();
      REQUIRE(frame);
      recording.messages.push_back(FrameText(0x80 | frame->opcode, frame->payload, false));
      return frame->payload;
    };
    take();
    take();
    session.Send(TextFrame(QueryMessage(1, R"({"max_triangles": 1500})")));
    while (!take().starts_with(R"({"id")")) {
    }
    return recording;
  }();
  return kRecording;
}

// What FetchMesh says to `answer`.
Status FetchFrom(const HostileServer::Answer& answer, double timeout, uint64_t* bytes = nullptr) {
  const HostileServer server(false, answer);
  FetchOptions options;
  options.timeout_seconds = timeout;
  const auto got = FetchMesh(server.url(), kQuery, options, [&](std::string_view piece) {
    if (bytes != nullptr) *bytes += piece.size();
    return Status::Ok();
  });
  if (!got.ok()) CHECK_THAT(got.status().message(), Catch::StartsWith("http://127.0.0.1:"));
  return got.status();
}

// What a session with one query comes to.
Status FollowFrom(const HostileServer::Answer& answer, double timeout, bool upgrade = true) {
  const HostileServer server(upgrade, answer);
  RemoteSessionOptions options;
  options.timeout_seconds = timeout;
  options.max_triangles = 10000;
  const auto session = RemoteSession::Open(server.url(), options);
  Status status = session.status();
  if (session.ok()) {
    const auto update = (*session)->Update(kQuery);
    status = update.status();
    CHECK(testing::ClientMeshFault((*session)->mesh()).empty());
    CHECK((*session)->connected() == status.ok());
  }
  if (!status.ok()) CHECK_THAT(status.message(), Catch::StartsWith("http://127.0.0.1:"));
  return status;
}

HostileServer::Answer Saying(const std::string& bytes) {
  return [bytes](const Say& say) { say(bytes); };
}
// `first`, then `piece` again and again, at once or one by one.
HostileServer::Answer Endless(const std::string& first, const std::string& piece,
                              bool slowly = false) {
  return [=](const Say& say) {
    if (!say(first)) return;
    std::string block = piece;
    while (!slowly && block.size() < 4096) block += piece;
    while (say(block)) {
      if (slowly) Pause();
    }
  };
}

TEST_CASE("fetch ends at every break of an answer, with an error", "[client]") {
  const std::string& whole = TheRecording().mesh;
  CHECK(FetchFrom(Saying(whole), kLong).ok());
  const size_t head = whole.find("\r\n\r\n") + 4;
  REQUIRE(head > 4);
  std::atomic<size_t> cut = 0;
  const HostileServer server(false, [&](const Say& say) { say(whole.substr(0, cut)); });
  for (cut = 0; cut < whole.size(); cut += cut < head + 40 ? 1 : 997) {
    INFO(cut);
    const auto got = FetchMesh(server.url(), kQuery, {}, [](auto) { return Status::Ok(); });
    CHECK_FALSE(got.ok());
  }
}

TEST_CASE("fetch takes no answer for a mesh that is none", "[client]") {
  const std::string& whole = TheRecording().mesh;
  const size_t head = whole.find("\r\n\r\n") + 4;
  const auto with = [&](const std::string& field, const std::string& line) {
    const size_t at = whole.find(field + ":");
    REQUIRE(at < head);
    return whole.substr(0, at) + line +
           whole.substr(whole.find("\r\n", at) + (line.empty() ? 2 : 0));
  };
  for (const std::string& answer :
       {std::string("\0\1\2\3", 4), std::string(100000, 'x'), with("Content-Length", ""),
        with("Content-Length", "Content-Length: 1000000000000000000"),
        with("Content-Length", "Content-Length: -1"), with("Content-Length", "Content-Length: x"),
        with("Content-Length", "Content-Length: 99999999999999999999999"),
        with("X-Mtdb-Vertices", ""), with("X-Mtdb-Vertices", "X-Mtdb-Vertices: many"),
        with("X-Mtdb-Error-Bound", "X-Mtdb-Error-Bound: nan"),
        with("X-Mtdb-Error-Bound", "X-Mtdb-Error-Bound: -1"),
        with("X-Mtdb-Shortfall", "X-Mtdb-Shortfall: {}"), with("X-Mtdb-Limit", "X-Mtdb-Limit:"),
        std::string("HTTP/1.1 302 Found\r\nLocation: /objects/a\r\nContent-Length: 0\r\n\r\n"),
        std::string("HTTP/1.1 100 Continue\r\n\r\n"), "HTTP/1.1 206 Part" + whole.substr(15)}) {
    INFO(answer.substr(0, head));
    CHECK_FALSE(FetchFrom(Saying(answer), kLong).ok());
  }
}

// What a terminal obeys, as JSON says it and as it is.
const std::string kControl = R"(\u001b[2J\u009b31m\u007f\r\n)";
bool HasControl(const std::string& text) {
  return std::ranges::any_of(text,
                             [](char c) {
                               const auto byte = static_cast<unsigned char>(c);
                               return (byte < ' ' && c != '\n') || byte == 0x7f;
                             }) ||
         text.find("\xc2\x9b") != std::string::npos;
}

std::string JsonAnswer(const std::string& status, const std::string& body) {
  return "HTTP/1.1 " + status + "\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" +
         body;
}

TEST_CASE("what a server says is printed as one line that no terminal obeys", "[client]") {
  const Folder folder;
  const std::string path = folder.File("path.jsonl");
  const std::string csv = folder.File("steps.csv");
  WriteText(path, std::string(kQuery) + "\n");
  const auto check = [](const Arguments& arguments) {
    const Outcome outcome = Run(arguments);
    INFO(outcome.out << outcome.err);
    CHECK(outcome.exit_code == 1);
    CHECK(IsOneLine(outcome.err));
    CHECK_FALSE(HasControl(outcome.out + outcome.err));
  };
  const std::string said = R"({"error": "x)" + kControl + "\"}";
  const std::string named = R"({"objects": [{"object": "x)" + kControl + "\"}]}";
  for (const std::string& answer :
       {JsonAnswer("404 Not Found", said), JsonAnswer("500 No\x1b[2J", said)}) {
    const HostileServer server(false, Saying(answer));
    check({"fetch", server.url(), folder.File("out.ply"), "--full"});
    check({"follow", server.url(), "--path", path});
  }
  {
    const HostileServer server(false, Saying(JsonAnswer("200 OK", named)));
    check({"fetch", server.url().substr(0, server.url().find("/objects")), folder.File("out.ply"),
           "--full"});
  }
  {
    std::string mesh = TheRecording().mesh;
    const size_t at = mesh.find("X-Mtdb-Limit: ") + 14;
    mesh.replace(at, mesh.find("\r\n", at) - at, "\x1b[2J");
    const HostileServer server(false, Saying(mesh));
    check({"fetch", server.url(), folder.File("out.ply"), "--full"});
  }
  const auto session = [&](const std::string& from, const std::string& to) {
    std::string all = TheRecording().start();
    all += Text(R"({"id":1,"done":{"triangles":0,"vertices":0,"active_triangles":0,)"
                R"("error_bound":0,"limit":"accuracy","shortfall":null,"insertions":0,)"
                R"("removals":0,"messages":0,"bytes":0,"milliseconds":0}})");
    const size_t at = all.find(from);
    REQUIRE(at != std::string::npos);
    // Within a frame the length must stay.
    REQUIRE(from.size() == to.size());
    return all.replace(at, from.size(), to);
  };
  for (const auto& [from, to] : {std::pair<std::string, std::string>{"sculpture", R"(sc\u001bre)"},
                                 {R"("accuracy")", R"("a\u001by")"},
                                 {"accuracy", "a,b\"c\\\"d"}}) {
    INFO(to);
    const HostileServer server(true, Saying(session(from, to.substr(0, from.size()))));
    check({"follow", server.url(), "--path", path, "--csv", csv});
    CHECK_FALSE(HasControl(ReadText(csv)));
  }
  {
    const std::string error = R"({"id":1,"error":"x)" + kControl + R"(","code":"busy"})";
    const HostileServer server(true, Saying(TheRecording().start() + Text(error)));
    check({"follow", server.url(), "--path", path});
  }
}

TEST_CASE("a catalog, an error and a header nested without end are refused", "[client]") {
  const std::string deep(8 << 20, '[');
  for (const std::string& answer :
       {JsonAnswer("200 OK", R"({"objects": )" + deep), JsonAnswer("404 No", deep),
        JsonAnswer("404 No", R"({"error": )" + deep)}) {
    const HostileServer server(false, Saying(answer));
    const std::string origin = server.url().substr(0, server.url().find("/objects"));
    for (const std::string& url : {origin, server.url()}) {
      CHECK_FALSE(FetchMesh(url, kQuery, {}, [](auto) { return Status::Ok(); }).ok());
    }
  }
}

TEST_CASE("fetch ends when an answer does not", "[client]") {
  const std::string ok = "HTTP/1.1 200 OK\r\n";
  CHECK_FALSE(FetchFrom(Endless(ok, "X-A: b\r\n"), kLong).ok());
  CHECK_FALSE(FetchFrom(Endless(ok, std::string(64, 'a')), kLong).ok());
  CHECK_FALSE(FetchFrom(Endless("HTTP/1.1 404 No\r\n\r\n", "text "), kLong).ok());
  const std::string mesh = ok + "X-Mtdb-Triangles: 1\r\n";
  uint64_t bytes = 0;
  CHECK_FALSE(FetchFrom(Endless(mesh + "\r\n", "text "), kLong, &bytes).ok());
  CHECK(bytes == 0);
  const std::string chunked = mesh + "Transfer-Encoding: chunked\r\n\r\n";
  CHECK_FALSE(FetchFrom(Endless(chunked + "5;a=", "b"), kShort).ok());
  CHECK_FALSE(FetchFrom(Endless(chunked + "0\r\n", "X-A: b\r\n"), kShort).ok());
  for (const std::string& first :
       {std::string(), ok, ok + "X-A: ", mesh + "Content-Length: 1000000\r\n\r\n", chunked}) {
    INFO(first);
    const std::string drip = first == chunked ? "1\r\na\r\n" : "a";
    CHECK_THAT(FetchFrom(Endless(first, drip, true), kShort).message(),
               Catch::Contains("does not answer"));
  }
}

TEST_CASE("a session ends at every break of its stream, with an error", "[client]") {
  const std::string whole = TheRecording().all();
  CHECK(FollowFrom(Saying(whole), kLong).ok());
  const size_t start = TheRecording().start().size();
  for (size_t cut = 0; cut < whole.size(); cut += cut % 500 < 20 ? 1 : 97) {
    INFO(cut);
    CHECK_FALSE(FollowFrom(Saying(whole.substr(0, cut)), kLong).ok());
  }
  std::mt19937 random(5);
  for (int i = 0; i < 100; ++i) {
    // Of the stream: control messages have no checksum.
    const size_t at = i % 2 == 0 ? TheRecording().messages[0].size() + random() % 1000
                                 : start + random() % (TheRecording().messages[2].size());
    std::string changed = whole;
    changed[at] = static_cast<char>(changed[at] ^ (1 + random() % 255));
    INFO(at);
    CHECK_FALSE(FollowFrom(Saying(changed), kShort).ok());
  }
}

TEST_CASE("a session is not opened by what is no upgrade", "[client]") {
  const std::string upgrade =
      "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n";
  for (const std::string& answer :
       {std::string(), std::string("\0\1\2\3", 4), std::string(100000, 'x'), upgrade + "\r\n",
        upgrade + "Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n\r\n",
        std::string("HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}"), TheRecording().mesh,
        std::string("HTTP/1.1 302 Found\r\nLocation: /\r\nContent-Length: 0\r\n\r\n")}) {
    INFO(answer.substr(0, 200));
    CHECK_FALSE(FollowFrom(Saying(answer), kLong, false).ok());
  }
  CHECK_FALSE(FollowFrom(Endless(upgrade, "X-A: b\r\n"), kLong, false).ok());
  CHECK_FALSE(FollowFrom(Endless("HTTP/1.1 404 No\r\n\r\n", "text "), kLong, false).ok());
  CHECK_FALSE(FollowFrom(Endless(upgrade, "a", true), kShort, false).ok());
}

TEST_CASE("a session ends when its stream goes on without an answer", "[client]") {
  const Recording& r = TheRecording();
  const std::string part = FrameText(kBinary, "", false);  // of a message that goes on
  const std::string more = FrameText(0, "", false);        // and on
  const std::string ping = FrameText(0x80 | kPing, "", false);
  const std::string kilobyte = FrameText(0, std::string(1000, '\1'), false);
  const std::string byte = FrameText(0, std::string(1, '\1'), false);
  for (const std::string& first : {std::string(), r.messages[0], r.start()}) {
    INFO(first.size());
    CHECK_FALSE(FollowFrom(Endless(first, ping), kShort).ok());
    CHECK_FALSE(FollowFrom(Endless(first, ping, true), kShort).ok());
    CHECK_FALSE(FollowFrom(Endless(first + part, more), kShort).ok());
    CHECK_FALSE(FollowFrom(Endless(first + part, more, true), kShort).ok());
    CHECK_FALSE(FollowFrom(Endless(first, Binary("")), kLong).ok());
    CHECK_FALSE(FollowFrom(Endless(first, Text("")), kLong).ok());
    CHECK_FALSE(FollowFrom(Endless(first + FrameText(kText, "{", false), kilobyte), kLong).ok());
    CHECK_FALSE(FollowFrom(Endless(first + FrameText(kText, "{", false), byte, true), kShort).ok());
    CHECK_FALSE(FollowFrom(Saying(first + FrameText(0x80 | kCloseFrame, "", false)), kLong).ok());
  }
  // A record that goes on and on.
  const std::string record = FrameText(kBinary, "\x7f", false);
  CHECK_FALSE(FollowFrom(Endless(r.start() + record, byte, true), kShort).ok());
  // Whole records, which do nothing.
  AdaptiveBit model;
  const std::string first = r.start() + Binary(EmptyRecords(5000, &model));
  const std::string records = EmptyRecords(3000, &model);
  REQUIRE(records == EmptyRecords(3000, &model));
  CHECK_THAT(FollowFrom(Endless(first, Binary(records)), kLong).message(),
             Catch::Contains("without an answer"));
  CHECK_THAT(FollowFrom(Endless(first + part, FrameText(0, records, false)), kLong).message(),
             Catch::Contains("without an answer"));
  CHECK_THAT(FollowFrom(Saying(r.start() + Text(R"({"id":1,"superseded":true})")), kLong).message(),
             Catch::Contains("later one"));
}

}  // namespace
}  // namespace mtdb::test
