// SPDX-License-Identifier: Apache-2.0
// Lines over points of the full-resolution surface: their lengths, labels in the scene, and files.
import * as three from 'three';
import type {Navigation} from './navigation';
import {add, dot, length, scale, sub, type Point} from './query';
import type {Hit} from './source';
import {kNoStretch, toPage} from './stretch';

export interface MeasuredLine {
  points: Hit[];
}

// In the page's unit.
export const distance = (a: Hit, b: Hit, stretch: Point) =>
  length(sub(toPage(b.point, stretch), toPage(a.point, stretch)));
export const lineLength = (line: MeasuredLine, stretch: Point) =>
  line.points.slice(1).reduce((sum, p, i) => sum + distance(line.points[i]!, p, stretch), 0);
// Of a line that has points.
export const rise = (line: MeasuredLine, up: Point) =>
  dot(sub(line.points.at(-1)!.point, line.points[0]!.point), up);
// How far off a length may be: each end of each segment, by its point's bound.
export const lengthError = (line: MeasuredLine) =>
  line.points.slice(1).reduce((sum, p, i) => sum + p.error_bound + line.points[i]!.error_bound, 0);

export class Measuring {
  readonly root = new three.Group();
  readonly lines: MeasuredLine[] = [];
  stretch = kNoStretch; // of lengths
  drawn = kNoStretch; // likewise, with heights as they are drawn
  private readonly strokes = new three.LineSegments(
    new three.BufferGeometry(),
    new three.LineBasicMaterial({color: 0xff5fa2, depthTest: false}),
  );
  private readonly dots = new three.Points(
    new three.BufferGeometry(),
    new three.PointsMaterial({color: 0xff5fa2, size: 9, sizeAttenuation: false, depthTest: false}),
  );
  private labels: {element: HTMLElement; place: Point; above: boolean}[] = [];

  constructor(
    private readonly layer: HTMLElement,
    private readonly navigation: Navigation,
    private readonly text: (units: number) => string,
    private readonly changed: () => void,
  ) {
    for (const drawn of [this.strokes, this.dots]) {
      drawn.frustumCulled = false;
      drawn.renderOrder = 5;
      this.root.add(drawn);
    }
  }

  addPoint(hit: Hit) {
    if (this.lines.length === 0) this.lines.push({points: []});
    this.lines.at(-1)!.points.push(hit);
    this.rebuild();
  }

  // Further points belong to another line.
  endLine() {
    if (this.lines.at(-1)?.points.length) this.lines.push({points: []});
  }

  undo() {
    while (this.lines.length > 0 && this.lines.at(-1)!.points.length === 0) this.lines.pop();
    this.lines.at(-1)?.points.pop();
    if (this.lines.at(-1)?.points.length === 0) this.lines.pop();
    this.rebuild();
  }

  clear() {
    this.lines.length = 0;
    this.rebuild();
  }

  replace(lines: MeasuredLine[]) {
    this.lines.splice(0, this.lines.length, ...lines);
    this.rebuild();
  }

  rebuild() {
    const scene = (p: Point) => this.navigation.toScene(toPage(p, this.drawn)).toArray();
    const dots: number[] = [],
      strokes: number[] = [];
    this.layer.replaceChildren();
    this.labels = [];
    for (const line of this.lines) {
      line.points.forEach((hit, i) => {
        dots.push(...scene(hit.point));
        if (i === 0) return;
        const before = line.points[i - 1]!;
        strokes.push(...scene(before.point), ...scene(hit.point));
        this.addLabel(
          scale(add(before.point, hit.point), 0.5),
          this.text(distance(before, hit, this.stretch)),
        );
      });
      const last = line.points.at(-1),
        height = last ? rise(line, this.navigation.up) : 0;
      if (line.points.length > 1)
        this.addLabel(
          last!.point,
          `${line.points.length > 2 ? `Σ ${this.text(lineLength(line, this.stretch))}  ` : ''}↕ ${height < 0 ? '−' : '+'}${this.text(Math.abs(height))}`,
          true,
        );
    }
    this.strokes.geometry.setAttribute(
      'position',
      new three.BufferAttribute(new Float32Array(strokes), 3),
    );
    this.dots.geometry.setAttribute(
      'position',
      new three.BufferAttribute(new Float32Array(dots), 3),
    );
    this.changed();
  }

  private addLabel(place: Point, text: string, above = false) {
    const element = document.createElement('div');
    element.className = 'label';
    element.textContent = text;
    this.layer.append(element);
    this.labels.push({element, place, above});
  }

  // Labels follow their places.
  update(width: number, height: number) {
    for (const {element, place, above} of this.labels) {
      const p = this.navigation.toScene(toPage(place, this.drawn)).project(this.navigation.camera);
      element.hidden = p.z > 1 || p.z < -1;
      element.style.transform = `translate(${((p.x + 1) / 2) * width}px, ${((1 - p.y) / 2) * height}px) translate(-50%, ${above ? -160 : -50}%)`;
    }
  }

  csv(): string {
    const rows = ['line,point,x,y,z,error,segment,length,height_difference'];
    this.lines.forEach((line, l) =>
      line.points.forEach((hit, i) => {
        const part = {points: line.points.slice(0, i + 1)};
        const segment = i > 0 ? distance(line.points[i - 1]!, hit, this.stretch) : 0;
        rows.push(
          [
            l + 1,
            i + 1,
            ...hit.point,
            hit.error_bound,
            segment,
            lineLength(part, this.stretch),
            rise(part, this.navigation.up),
          ].join(','),
        );
      }),
    );
    return rows.join('\n') + '\n';
  }

  geoJson(): string {
    const features = this.lines
      .filter(line => line.points.length > 0)
      .map((line, l) => ({
        type: 'Feature',
        geometry:
          line.points.length > 1
            ? {type: 'LineString', coordinates: line.points.map(p => p.point)}
            : {type: 'Point', coordinates: line.points[0]!.point},
        properties: {
          line: l + 1,
          length: lineLength(line, this.stretch),
          length_error: lengthError(line),
          height_difference: rise(line, this.navigation.up),
          coordinates: 'as in the object',
        },
      }));
    return JSON.stringify({type: 'FeatureCollection', features}, null, 2) + '\n';
  }
}
