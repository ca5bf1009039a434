// SPDX-License-Identifier: Apache-2.0
// Elements of the page, and how it writes numbers.
export const byId = <T extends HTMLElement = HTMLElement>(id: string) =>
  document.getElementById(id) as T;
export const select = (id: string) => byId<HTMLSelectElement>(id);
export const input = (id: string) => byId<HTMLInputElement>(id);

// A few figures, as people write them.
export function figure(x: number, digits = 3): string {
  if (x === 0 || !Number.isFinite(x)) return String(x);
  const a = Math.abs(x);
  if (a >= 1e6 || a < 1e-4) return x.toExponential(digits - 1);
  return String(Number(x.toPrecision(Math.max(digits, Math.ceil(Math.log10(a) + 1e-9)))));
}
export const whole = (x: number) => Math.round(x).toLocaleString('en');

// Hands the user a file.
export function download(blob: Blob, name: string) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name.replace(/[\/\\:*?"<>|\u0000-\u001f]/g, '_');
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}
