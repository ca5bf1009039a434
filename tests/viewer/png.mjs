// SPDX-License-Identifier: Apache-2.0
// Images for tests, as PNG files.
import {deflateSync} from 'node:zlib';

function crc(bytes) {
  let c = 0xffffffff;
  for (const b of bytes) {
    c ^= b;
    for (let k = 0; k < 8; ++k) c = c & 1 ? (c >>> 1) ^ 0xedb88320 : c >>> 1;
  }
  return ~c >>> 0;
}

// `pixel`: red, green, blue and alpha at a column and a row.
export function png(columns, rows, pixel) {
  const raw = Buffer.alloc(rows * (1 + 4 * columns));
  for (let y = 0; y < rows; ++y)
    for (let x = 0; x < columns; ++x) raw.set(pixel(x, y), y * (1 + 4 * columns) + 1 + 4 * x);
  const chunk = (kind, data) => {
    const body = Buffer.concat([Buffer.from(kind), data]),
      out = Buffer.alloc(body.length + 8);
    out.writeUInt32BE(data.length);
    body.copy(out, 4);
    out.writeUInt32BE(crc(body), body.length + 4);
    return out;
  };
  const head = Buffer.alloc(13);
  head.writeUInt32BE(columns);
  head.writeUInt32BE(rows, 4);
  head.set([8, 6], 8);
  return Buffer.concat([
    Buffer.from('\x89PNG\r\n\x1a\n', 'latin1'),
    chunk('IHDR', head),
    chunk('IDAT', deflateSync(raw)),
    chunk('IEND', Buffer.alloc(0)),
  ]);
}
