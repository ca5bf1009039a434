// SPDX-License-Identifier: Apache-2.0
// Colour maps, from low to high. All but "tints" rise evenly in lightness; cividis is made for
// people who do not tell red from green. Viridis and cividis: matplotlib's, in the public domain
// (CC0).
export const colourMaps: Record<string, string[]> = {
  viridis: [
    '#440154',
    '#482475',
    '#414487',
    '#355f8d',
    '#2a788e',
    '#21918c',
    '#22a884',
    '#44bf70',
    '#7ad151',
    '#bddf26',
    '#fde725',
  ],
  cividis: [
    '#00224e',
    '#083370',
    '#35456c',
    '#4f576c',
    '#666970',
    '#7d7c78',
    '#948e77',
    '#aea371',
    '#c8b866',
    '#e5cf52',
    '#fee838',
  ],
  tints: [
    '#3b6b4f',
    '#6f9a5f',
    '#a9bf76',
    '#dcd39a',
    '#c9a673',
    '#a97c5a',
    '#94735f',
    '#b3a29a',
    '#d8d0cc',
    '#ffffff',
  ],
  grey: ['#202020', '#f5f5f5'],
};

const component = (colour: string, k: number) => parseInt(colour.slice(1 + 2 * k, 3 + 2 * k), 16);

// 256 colours, four bytes each.
export function colourTable(name: string): Uint8Array {
  const stops = colourMaps[name] ?? colourMaps.viridis!;
  const table = new Uint8Array(4 * 256);
  for (let i = 0; i < 256; ++i) {
    const place = (i / 255) * (stops.length - 1);
    const low = Math.min(Math.floor(place), stops.length - 2);
    for (let k = 0; k < 3; ++k) {
      const a = component(stops[low]!, k),
        b = component(stops[low + 1]!, k);
      table[4 * i + k] = Math.round(a + (b - a) * (place - low));
    }
    table[4 * i + 3] = 255;
  }
  return table;
}
