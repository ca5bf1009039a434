// SPDX-License-Identifier: Apache-2.0
// node remote_test.mjs MTDB: what the program sends to servers that want signatures, certificates
// and passwords, and to whom it sends none: checked by servers that count the signatures themselves.
import assert from 'node:assert/strict';
import {execFile, execFileSync} from 'node:child_process';
import {createHash, createHmac} from 'node:crypto';
import {mkdtempSync, readFileSync, rmSync} from 'node:fs';
import {createServer} from 'node:http';
import {createSecureServer as createHttp2Server} from 'node:http2';
import {createServer as createSecureServer} from 'node:https';
import {tmpdir} from 'node:os';
import {join} from 'node:path';

const mtdb = process.argv[2];
const folder = mkdtempSync(join(tmpdir(), 'mtdb-remote-'));
process.on('exit', () => rmSync(folder, {recursive: true, force: true}));
const file = name => join(folder, name);
const run = (...args) => execFileSync(mtdb, args, {stdio: ['ignore', 'pipe', 'pipe']});
run('generate', 'terrain', file('a.ply'), '--triangles', '20000');
run('ingest', file('a.ply'), file('a.mtdb'), '--name', 'a', '--quiet');
run('pack', file('a.mtdb'), file('a.mtdbp'));
run('extract', file('a.mtdb'), file('a.out.ply'));
const packed = readFileSync(file('a.mtdbp')), mesh = readFileSync(file('a.out.ply'));

// Beside servers of this process: exit status and what was said. `env`: in place of all that is AWS's or curl's.
const plain = Object.fromEntries(Object.entries(process.env).filter(([name]) => !/^AWS_|_proxy$|^CURL_|^SSL_/i.test(name)));
const extract = (url, env = {}) => new Promise(done => {
  rmSync(file('b.ply'), {force: true});
  execFile(mtdb, ['extract', url, file('b.ply')], {env: {...plain, HOME: folder, ...env}}, (error, _, text) => done({code: error ? error.code : 0, text}));
});
async function extracts(url, env) {
  const {code, text} = await extract(url, env);
  assert.equal(code, 0, text);
  assert.ok(readFileSync(file('b.ply')).equals(mesh));
}
async function fails(words, url, env) {
  const {code, text} = await extract(url, env);
  assert.equal(code, 1, text);
  assert.match(text, words);
}

function sendRange(request, response) {
  const [, begin, end] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range).map(Number);
  const body = packed.subarray(begin, Math.min(end + 1, packed.length));
  response.writeHead(206, {'Content-Range': `bytes ${begin}-${begin + body.length - 1}/${packed.length}`, ETag: '"1"'});
  response.end(body);
}
const servers = [];
async function serve(answer, tls) {
  const seen = [];
  const take = (request, response) => {
    seen.push(request);
    answer(request, response);
  };
  const server = tls ? createSecureServer(tls, take) : createServer(take);
  await new Promise(done => server.listen(0, done));
  servers.push(server);
  return {port: server.address().port, seen};
}

// ---- signatures of version 4, as Amazon specifies them ----

const hmac = (key, text) => createHmac('sha256', key).update(text).digest();
function signature({method, path, query, headers, signed, hash, date, region, service, secret}) {
  const canonical = [method, path, query, ...signed.map(name => `${name}:${headers[name].trim().replace(/ +/g, ' ')}`), '', signed.join(';'), hash].join('\n');
  const scope = `${date.slice(0, 8)}/${region}/${service}/aws4_request`;
  const text = ['AWS4-HMAC-SHA256', date, scope, createHash('sha256').update(canonical).digest('hex')].join('\n');
  const key = [date.slice(0, 8), region, service, 'aws4_request'].reduce(hmac, `AWS4${secret}`);
  return hmac(key, text).toString('hex');
}
const emptyHash = createHash('sha256').update('').digest('hex');
// The checker against the example in Amazon's documentation, "GET Object".
assert.equal(signature({
  method: 'GET', path: '/test.txt', query: '', signed: ['host', 'range', 'x-amz-content-sha256', 'x-amz-date'], hash: emptyHash, date: '20130524T000000Z', region: 'us-east-1', service: 's3',
  secret: 'wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY',
  headers: {host: 'examplebucket.s3.amazonaws.com', range: 'bytes=0-9', 'x-amz-content-sha256': emptyHash, 'x-amz-date': '20130524T000000Z'},
}), 'f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41');

const keys = {AWS_ACCESS_KEY_ID: 'AKIDEXAMPLE', AWS_SECRET_ACCESS_KEY: 'wJalrXUtnFEMI/K7MDENG+bPxRfiCYEXAMPLEKEY'};
let region = 'us-east-1', token, wantedPath = '';
function isSigned(request) {
  const {headers} = request, [path, query = ''] = request.url.split('?');
  const parts = /^AWS4-HMAC-SHA256 Credential=([^/]+)\/(\d{8})\/([^/]+)\/s3\/aws4_request, ?SignedHeaders=([^,]+), ?Signature=([0-9a-f]{64})$/.exec(headers.authorization ?? '');
  if (!parts) return `no signature: ${headers.authorization}`;
  const [, id, day, where, list, given] = parts, signed = list.split(';'), date = headers['x-amz-date'];
  if (id !== keys.AWS_ACCESS_KEY_ID || where !== region || !date.startsWith(day)) return 'another scope';
  if (Math.abs(Date.now() - Date.parse(date.replace(/(....)(..)(..)T(..)(..)(..)Z/, '$1-$2-$3T$4:$5:$6Z'))) > 900_000) return 'another time';
  if (!['host', 'x-amz-date'].every(name => signed.includes(name)) || signed.some((name, i) => i > 0 && signed[i - 1] >= name)) return `signed headers ${list}`;
  if (headers['x-amz-content-sha256'] !== emptyHash) return 'the hash of the body';
  if (headers['x-amz-security-token'] !== token || (token && !signed.includes('x-amz-security-token'))) return 'the session token';
  if (path !== wantedPath) return `the path ${path}`;
  const right = signature({method: request.method, path, query, headers, signed, hash: emptyHash, date, region, service: 's3', secret: keys.AWS_SECRET_ACCESS_KEY});
  return right === given ? '' : 'the signature';
}
let wrong = '';
const s3 = await serve((request, response) => {
  wrong = isSigned(request);
  if (!wrong) return sendRange(request, response);
  response.writeHead(403);
  response.end();
});
const endpoint = {AWS_ENDPOINT_URL: `http://127.0.0.1:${s3.port}`};
for (const [where, session, key, path] of [
  ['us-east-1', undefined, 'a.mtdbp', '/bucket/a.mtdbp'], ['eu-central-1', 'FwoGZXIvYXdzEJr//////////wEaDK+=', 'deep/folder/a.mtdbp', '/bucket/deep/folder/a.mtdbp'],
  ['us-east-1', undefined, 'Hügel+(1)=a~b.mtdbp', '/bucket/H%C3%BCgel%2B%281%29%3Da~b.mtdbp'],
]) {
  [region, token, wantedPath] = [where, session, path];
  await extracts(`s3://bucket/${key}`, {...keys, ...endpoint, AWS_REGION: where, ...(session ? {AWS_SESSION_TOKEN: session} : {})});
  assert.equal(wrong, '');
}
await fails(/403.*credentials/, 's3://bucket/Hügel+(1)=a~b.mtdbp', {...keys, ...endpoint, AWS_SECRET_ACCESS_KEY: 'another'});
assert.equal(wrong, 'the signature');
await fails(/403.*credentials/, 's3://bucket/a.mtdbp', endpoint);
console.log('S3: signatures are right');

// ---- redirects ----

const seenElsewhere = () => elsewhere.seen.flatMap(r => [r.headers.authorization, r.headers['x-amz-security-token'], r.headers.cookie]).filter(Boolean);
const elsewhere = await serve(sendRange);
const redirecting = await serve((request, response) => {
  response.writeHead(307, {Location: `http://localhost:${elsewhere.port}/a.mtdbp`});
  response.end();
});
await extracts(`http://127.0.0.1:${redirecting.port}/a.mtdbp`);
await extracts(`http://me:secret@127.0.0.1:${redirecting.port}/a.mtdbp`);
assert.ok(redirecting.seen.some(r => r.headers.authorization === `Basic ${Buffer.from('me:secret').toString('base64')}`));
assert.deepEqual(seenElsewhere(), []);
await fails(/307.*AWS_/, 's3://bucket/a.mtdbp', {...keys, AWS_SESSION_TOKEN: 'token', AWS_ENDPOINT_URL: `http://127.0.0.1:${redirecting.port}`});
assert.deepEqual(seenElsewhere(), []);
console.log('redirects carry no credentials');

// ---- certificates ----

let hasOpenssl = true;
try {
  execFileSync('openssl', ['req', '-x509', '-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:prime256v1', '-nodes', '-days', '2', '-subj', '/CN=localhost', '-addext', 'subjectAltName=DNS:localhost',
    '-keyout', file('key.pem'), '-out', file('cert.pem')], {stdio: 'ignore'});
} catch {
  hasOpenssl = false;
  console.log('skipped: openssl is not installed, so https was not tried');
}
if (hasOpenssl) {
  const secure = await serve(sendRange, {key: readFileSync(file('key.pem')), cert: readFileSync(file('cert.pem'))});
  const url = `https://localhost:${secure.port}/a.mtdbp`;
  await fails(/certificate/i, url);
  assert.equal(secure.seen.length, 0);
  await extracts(url, {CURL_CA_BUNDLE: file('cert.pem')});
  await extracts(url, {SSL_CERT_FILE: file('cert.pem')});
  await fails(/certificate|name/i, url.replace('localhost', '127.0.0.1'), {CURL_CA_BUNDLE: file('cert.pem')});
  // From https never to http.
  const down = await serve((_, response) => {
    response.writeHead(302, {Location: `http://localhost:${elsewhere.port}/a.mtdbp`});
    response.end();
  }, {key: readFileSync(file('key.pem')), cert: readFileSync(file('cert.pem'))});
  const before = elsewhere.seen.length;
  await fails(/./, `https://localhost:${down.port}/a.mtdbp`, {CURL_CA_BUNDLE: file('cert.pem')});
  assert.equal(elsewhere.seen.length, before);
  console.log('certificates are checked');

  // A server that speaks HTTP/2 is spoken to so, over one connection however many requests are under way. The file is
  // large enough for several; one that offers HTTP/1.1 only gets that, above.
  const large = file('large.mtdbp');
  run('generate', 'sculpture', file('large.ply'), '--triangles', '200000');
  run('ingest', file('large.ply'), file('large.mtdb'), '--name', 'large', '--quiet');
  run('pack', file('large.mtdb'), large);
  const bytes = readFileSync(large), versions = new Set();
  let connections = 0, requests = 0;
  const server = createHttp2Server({key: readFileSync(file('key.pem')), cert: readFileSync(file('cert.pem')), allowHTTP1: true}, (request, response) => {
    ++requests;
    versions.add(request.httpVersion);
    const [, begin, end] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range).map(Number);
    const body = bytes.subarray(begin, Math.min(end + 1, bytes.length));
    response.writeHead(206, {'Content-Range': `bytes ${begin}-${begin + body.length - 1}/${bytes.length}`, ETag: '"1"'});
    response.end(body);
  });
  server.on('secureConnection', () => ++connections);
  await new Promise(done => server.listen(0, done));
  const {code, text} = await extract(`https://localhost:${server.address().port}/large.mtdbp`, {CURL_CA_BUNDLE: file('cert.pem')});
  assert.equal(code, 0, text);
  run('extract', large, file('c.ply'));
  assert.ok(readFileSync(file('b.ply')).equals(readFileSync(file('c.ply'))));
  assert.deepEqual([...versions], ['2.0']);
  assert.equal(connections, 1);
  assert.ok(requests > 2, `${requests} requests`);
  server.close();
  console.log(`HTTP/2: ${requests} requests over one connection`);
}
for (const server of servers) {
  server.close();
  server.closeAllConnections();
}
