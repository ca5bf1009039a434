// SPDX-License-Identifier: Apache-2.0
#include "tools/client/http_client.h"

#include <algorithm>
#include <array>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/buffer_body.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/read.hpp>
#include <boost/beast/http/string_body.hpp>
#include <boost/beast/http/write.hpp>
#include <cctype>
#include <limits>
#include <utility>

#include "store/base/redact.h"
#include "tools/client/internal/blocking_connection.h"
#include "tools/client/network.h"

namespace mtdb {

using namespace internal;

namespace {

constexpr uint32_t kMaxHeaderBytes = 64 << 10;

std::string LowerCase(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

}  // namespace

std::string HttpUrl::origin() const {
  const bool colons = host.find(':') != std::string::npos;
  return "http://" + (colons ? "[" + host + "]" : host) + ":" + port;
}

Result<HttpUrl> ParseHttpUrl(const std::string& text) {
  const Status wrong =
      InvalidArgument("expected a URL such as http://localhost:8080/objects/scan, found '" +
                      WithoutSecrets(text) + "'");
  constexpr std::string_view kScheme = "http://";
  if (!text.starts_with(kScheme)) return wrong;
  const size_t slash = std::min(text.find('/', kScheme.size()), text.size());
  const std::string authority = text.substr(kScheme.size(), slash - kScheme.size());
  HttpUrl url;
  url.path = slash < text.size() ? text.substr(slash) : "/";
  const size_t bracket = authority.find(']');
  const size_t colon =
      authority.find(':', authority.starts_with('[') && bracket != std::string::npos ? bracket : 0);
  url.host = authority.substr(0, colon);
  url.port = colon == std::string::npos ? "80" : authority.substr(colon + 1);
  if (url.host.starts_with('[')) {
    if (!url.host.ends_with(']')) return wrong;
    url.host = url.host.substr(1, url.host.size() - 2);
  }
  const auto is_digit = [](unsigned char c) { return std::isdigit(c) != 0; };
  const auto is_plain = [](unsigned char c) { return c > ' ' && c < 0x7f && c != '@'; };
  if (url.host.empty() || url.port.empty() || url.port.size() > 5 ||
      !std::all_of(url.port.begin(), url.port.end(), is_digit) || std::stoi(url.port) > 65535 ||
      !std::all_of(text.begin(), text.end(), is_plain) ||
      url.path.find_first_of("?#") != std::string::npos) {
    return wrong;
  }
  return url;
}

std::string HttpResponse::header(const std::string& name) const {
  const auto at = headers.find(name);
  return at == headers.end() ? "" : at->second;
}

std::string PercentEncode(const std::string& text) {
  constexpr const char* kDigits = "0123456789ABCDEF";
  std::string encoded;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x80 &&
        (std::isalnum(byte) != 0 || std::string_view("-._~").find(c) != std::string_view::npos)) {
      encoded += c;
    } else {
      encoded += {'%', kDigits[byte >> 4], kDigits[byte & 15]};
    }
  }
  return encoded;
}

struct HttpClient::Connection {
  BlockingConnection base;
  beast::flat_buffer buffer{2 * kMaxHeaderBytes};
};

HttpClient::HttpClient(std::unique_ptr<Connection> connection)
    : connection_(std::move(connection)) {}
HttpClient::~HttpClient() = default;

Result<std::unique_ptr<HttpClient>> HttpClient::Connect(const HttpUrl& url, double idle_seconds) {
  std::unique_ptr<Connection> c(new Connection{{url, idle_seconds}});
  MTDB_RETURN_IF_ERROR(c->base.Connect());
  return std::unique_ptr<HttpClient>(new HttpClient(std::move(c)));
}

Result<HttpResponse> HttpClient::Send(const std::string& method, const std::string& target,
                                      const std::string& body, const Receiver& receive) {
  BlockingConnection& c = connection_->base;
  beast::flat_buffer& buffer = connection_->buffer;
  http::request<http::string_body> request;
  request.method_string(method);
  request.target(target);
  request.version(11);
  request.set(http::field::host, c.url().origin().substr(7));
  request.set(http::field::user_agent, "mtdb");
  if (!body.empty()) {
    request.set(http::field::content_type, "application/json");
    request.body() = body;
    request.prepare_payload();
  }
  ErrorCode error = c.Await([&](auto&& done) {
    http::async_write(c.stream(), request, std::forward<decltype(done)>(done));
  });
  // A server that refuses may answer and close before it has read everything.
  if (error == beast::error::timeout) return c.Failure("sending", error);

  http::response_parser<http::buffer_body> parser;
  parser.header_limit(kMaxHeaderBytes);
  parser.body_limit(std::numeric_limits<uint64_t>::max());
  error = c.Await([&](auto&& done) {
    http::async_read_header(c.stream(), buffer, parser, std::forward<decltype(done)>(done));
  });
  if (error) return c.Failure("waiting for an answer", error);
  HttpResponse response;
  response.status = parser.get().result_int();
  for (const auto& field : parser.get()) {
    response.headers[LowerCase(std::string(field.name_string()))] = std::string(field.value());
  }
  response.until_close = parser.need_eof();
  c.Progress();
  std::array<char, kBlockBytes> block;
  while (!parser.is_done()) {
    parser.get().body().data = block.data();
    parser.get().body().size = block.size();
    error = c.AwaitMore([&](auto&& done) {
      http::async_read_some(c.stream(), buffer, parser, std::forward<decltype(done)>(done));
    });
    if (error && error != http::error::need_buffer) return c.Failure("the answer broke off", error);
    const size_t size = block.size() - parser.get().body().size;
    c.Received(size);
    MTDB_RETURN_IF_ERROR(receive(response, std::string_view(block.data(), size)));
  }
  return response;
}

}  // namespace mtdb
