// SPDX-License-Identifier: Apache-2.0
// One object's mesh on the graphics card: arrays of slots, of which only what changes is sent
// there.
import * as three from 'three';
import type {Place} from './placed_image';
import {sub, type Point} from './query';
import {edgeMaterial, surfaceMaterial, tableTexture, type Uniforms} from './shaders';
import type {MeshUpdate, Slots} from './source';
import {toPage} from './stretch';
import {TexturedFaces, ValuedFaces} from './triangle_faces';

// Before there are tables: a sampler of integers wants such a texture.
const noTable = tableTexture(new Uint32Array(1));

const kSpare = 1.4; // how much larger arrays are made than they must be

type Data = Uint32Array | Float32Array | Int16Array | Uint8Array;

function write(attribute: three.BufferAttribute, slots: Slots<Data>, count: number) {
  const {ranges, data} = slots;
  const array = attribute.array as Data;
  for (let i = 0, at = 0; i < ranges.length; i += 2) {
    const begin = ranges[i]! * count,
      size = (ranges[i + 1]! - ranges[i]!) * count;
    array.set(data.subarray(at, at + size) as never, begin);
    attribute.addUpdateRange(begin, size);
    at += size;
  }
  if (ranges.length > 0) attribute.needsUpdate = true;
}

// Frees what it has on the card, but not the attributes that other geometries have too: three would
// not notice that these have to bind them anew.
function release(geometry: three.BufferGeometry, kept: Iterable<three.BufferAttribute>) {
  const others = new Set<unknown>(kept);
  for (const [name, attribute] of Object.entries(geometry.attributes))
    if (others.has(attribute)) geometry.deleteAttribute(name);
  if (others.has(geometry.index)) geometry.setIndex(null);
  geometry.dispose();
}

// An image over the mesh.
export interface Drape {
  texture: three.Texture;
  place: Place;
}

// What the shader knows of the pages of a texture, and which of its tiles are on the card.
export interface TextureTables {
  pages: three.Texture;
  entries: three.Texture;
  pageCount: number;
  book: number; // by which the tiles that are wanted name the object
}

export class ObjectMesh {
  readonly group = new three.Group();
  triangles = 0;
  vertices = 0;
  triangleSlots = 0;
  origin: Point = [0, 0, 0];
  valueRange: [number, number] | null = null;
  applyMilliseconds = 0; // of the last update
  private vertexSlots = 0;
  private triangleRoom = 0;
  private vertexRoom = 0;
  private index = new three.BufferAttribute(new Uint32Array(0), 3);
  private attributes: Record<string, three.BufferAttribute> = {};
  private geometry = new three.BufferGeometry();
  private edgeIndex: three.BufferAttribute | null = null;
  private edgeGeometry: three.BufferGeometry | null = null;
  private faces: ValuedFaces | TexturedFaces | null = null; // drawn in place of `geometry` while triangles have values or corners
  private readonly plainMaterial: three.RawShaderMaterial;
  private textured: three.RawShaderMaterial | null = null;
  private readonly own = {
    valued: {value: 0}, // what vertices have, as colourBy counts: colours, or a scalar
    place: {value: new three.Vector3()},
    draped: {value: false},
    image: {value: null as three.Texture | null},
    imageMiddle: {value: new three.Vector2()},
    imageAcross: {value: new three.Vector2()},
    imageDown: {value: new three.Vector2()},
    pages: {value: noTable as three.Texture},
    entries: {value: noTable as three.Texture},
    pageCount: {value: 0},
    book: {value: 0},
  };
  private over: Drape | null = null;
  private readonly surface: three.Mesh;
  private readonly edges: three.LineSegments;

  // `frame`: the page's point that is the scene's origin. Positions on the card are relative to
  // points nearby, so that float32 suffices however large the coordinates are.
  constructor(
    private readonly shared: Uniforms,
    private frame: Point,
    private stretch: Point,
  ) {
    this.plainMaterial = surfaceMaterial(shared, this.own);
    this.surface = new three.Mesh(this.geometry, this.plainMaterial);
    this.edges = new three.LineSegments(undefined, edgeMaterial(shared, this.own));
    this.surface.frustumCulled = this.edges.frustumCulled = false;
    this.edges.visible = false;
    this.edges.renderOrder = 1;
    this.group.add(this.surface, this.edges);
  }

  place(frame: Point, stretch: Point) {
    this.frame = frame;
    this.stretch = stretch;
    this.group.position.set(...sub(toPage(this.origin, stretch), frame));
    this.own.place.value.copy(this.group.position);
  }

  // Some of the vertices, in the page's coordinates, to see where the mesh lies.
  someVertices(most: number): Float64Array {
    const p = this.attributes.position?.array ?? [],
      every = Math.max(1, Math.ceil(this.vertexSlots / most));
    const out = new Float64Array(3 * Math.ceil(this.vertexSlots / every));
    for (let v = 0, at = 0; v < this.vertexSlots; v += every)
      for (let k = 0; k < 3; ++k) out[at++] = (this.origin[k]! + p[3 * v + k]!) * this.stretch[k]!;
    return out;
  }

  apply(update: MeshUpdate) {
    const begin = performance.now();
    if (update.fresh) this.triangleRoom = this.vertexRoom = 0;
    this.makeRoom(update);
    this.triangles = update.triangles;
    this.vertices = update.vertices;
    this.triangleSlots = update.triangleSlots;
    this.vertexSlots = update.vertexSlots;
    this.origin = update.origin;
    this.valueRange = update.valueRange;
    this.place(this.frame, this.stretch);
    this.placeImage();
    write(this.index, update.indices, 3);
    write(this.attributes.position!, update.positions, 3);
    write(this.attributes.normal!, update.normals, 4);
    if (update.values) {
      const colours = update.values.data instanceof Uint8Array;
      this.own.valued.value = colours ? 1 : 2;
      write(this.valueAttribute(colours ? 'colour' : 'scalar'), update.values, colours ? 4 : 1);
    }
    this.geometry.setDrawRange(0, 3 * update.triangleSlots);
    if (this.edgeIndex) this.writeEdges(update.indices.ranges);
    if (update.triangleValues || update.corners) this.writeFaces(update);
    else this.dropFaces();
    this.applyMilliseconds = performance.now() - begin;
  }

  set drape(drape: Drape | null) {
    this.over = drape;
    this.own.draped.value = drape !== null;
    this.own.image.value = drape?.texture ?? null;
    this.placeImage();
  }

  private placeImage() {
    if (!this.over) return;
    const {middle, across, down} = this.over.place;
    this.own.imageMiddle.value.set(middle[0] - this.origin[0], middle[1] - this.origin[1]);
    this.own.imageAcross.value.set(...across);
    this.own.imageDown.value.set(...down);
  }

  set wireframe(on: boolean) {
    if (on === this.edges.visible) return;
    this.edges.visible = on;
    // Room for the edges. Where there are none it would only let what is behind shine through.
    for (const material of [this.plainMaterial, this.textured])
      if (material) material.polygonOffset = on;
    if (on) {
      this.makeEdges();
    } else {
      this.dropEdges();
    }
  }

  private dropFaces() {
    if (!this.faces) return;
    this.faces.geometry.dispose();
    this.faces = null;
    this.surface.geometry = this.geometry;
    this.surface.material = this.plainMaterial;
  }

  // The value of each triangle, in the order of readTriangles; for test programs.
  readValues(): Float32Array | null {
    const index = this.index.array,
      {faces} = this;
    if (!(faces instanceof ValuedFaces)) return null;
    return Float32Array.from({length: this.triangleSlots}, (_, i) => i)
      .filter(i => index[3 * i] !== index[3 * i + 1])
      .map(i => faces.values[3 * i]!);
  }

  private writeFaces(update: MeshUpdate) {
    const before = this.faces?.takes(update) ? this.faces : null;
    const fresh = !before || before.room !== this.triangleRoom;
    if (fresh) {
      const Kind = update.corners ? TexturedFaces : ValuedFaces;
      const faces = new Kind(this.triangleRoom, before);
      this.faces?.geometry.dispose();
      this.faces = faces;
      this.surface.geometry = faces.geometry;
      this.surface.material = update.corners ? this.texturedMaterial() : this.plainMaterial;
    }
    const {position, normal} = this.attributes;
    this.faces!.write(
      update,
      {
        index: this.index.array,
        positions: position!.array,
        normals: normal!.array,
        triangleSlots: this.triangleSlots,
      },
      fresh ? [0, this.triangleSlots] : update.indices.ranges,
    );
  }

  private texturedMaterial() {
    if (!this.textured) {
      this.textured = surfaceMaterial(this.shared, this.own, true);
      this.textured.polygonOffset = this.edges.visible;
    }
    return this.textured;
  }

  // Whether it is drawn with its texture, as far as that is there.
  get isTextured() {
    return this.faces instanceof TexturedFaces;
  }

  // The tables of its texture; see page_table.ts.
  set pages(tables: TextureTables | null) {
    this.own.pages.value = tables?.pages ?? noTable;
    this.own.entries.value = tables?.entries ?? noTable;
    this.own.pageCount.value = tables?.pageCount ?? 0;
    this.own.book.value = tables?.book ?? 0;
  }

  // Corner by corner, in model units; test programs compare them with those of `mtdb extract`.
  readTriangles(): Float64Array {
    const out = new Float64Array(9 * this.triangles);
    const index = this.index.array,
      p = this.attributes.position?.array;
    let at = 0;
    for (let i = 0; i < 3 * this.triangleSlots; i += 3) {
      if (index[i] === index[i + 1]) continue;
      for (let c = 0; c < 3; ++c) {
        for (let k = 0; k < 3; ++k) out[at++] = this.origin[k]! + p![3 * index[i + c]! + k]!;
      }
    }
    return out;
  }

  dispose() {
    this.dropEdges();
    this.dropFaces();
    this.geometry.dispose();
    this.plainMaterial.dispose();
    this.textured?.dispose();
    (this.edges.material as three.Material).dispose();
  }

  private makeRoom(update: MeshUpdate) {
    const moreTriangles = update.triangleSlots > this.triangleRoom,
      moreVertices = update.vertexSlots > this.vertexRoom;
    if (!moreTriangles && !moreVertices) return;
    const before = this.geometry;
    const grown = (
      old: three.BufferAttribute | undefined,
      Kind: new (n: number) => Data,
      slots: number,
      count: number,
      used: number,
      normalized = false,
    ) => {
      const array = new Kind(slots * count);
      if (old) array.set((old.array as Data).subarray(0, used * count) as never);
      const attribute = new three.BufferAttribute(array, count, normalized);
      attribute.setUsage(three.DynamicDrawUsage);
      return attribute;
    };
    const keep = !update.fresh;
    if (moreTriangles) {
      this.triangleRoom = Math.ceil(update.triangleSlots * kSpare) + 1024;
      const used = keep ? this.triangleSlots : 0;
      const index = grown(keep ? this.index : undefined, Uint32Array, this.triangleRoom, 3, used);
      // Three takes an index for a list of single numbers.
      this.index = new three.BufferAttribute(index.array, 1);
      this.index.setUsage(three.DynamicDrawUsage);
    }
    if (moreVertices) {
      this.vertexRoom = Math.ceil(update.vertexSlots * kSpare) + 1024;
      const used = keep ? this.vertexSlots : 0;
      const old = keep ? this.attributes : {};
      const room = this.vertexRoom;
      this.attributes = {
        position: grown(old.position, Float32Array, room, 3, used),
        normal: grown(old.normal, Int16Array, room, 4, used, true),
        ...(old.colour ? {colour: grown(old.colour, Uint8Array, room, 4, used, true)} : {}),
        ...(old.scalar ? {scalar: grown(old.scalar, Float32Array, room, 1, used)} : {}),
      };
    }
    this.geometry = new three.BufferGeometry();
    this.geometry.setIndex(this.index);
    for (const [name, attribute] of Object.entries(this.attributes))
      this.geometry.setAttribute(name, attribute);
    if (!this.faces) this.surface.geometry = this.geometry;
    release(before, [this.index, ...Object.values(this.attributes)]);
    if (this.edges.visible) {
      this.triangleSlots = keep ? this.triangleSlots : 0;
      this.makeEdges();
    }
  }

  private valueAttribute(name: 'colour' | 'scalar'): three.BufferAttribute {
    let attribute = this.attributes[name];
    if (!attribute) {
      attribute =
        name === 'colour'
          ? new three.BufferAttribute(new Uint8Array(4 * this.vertexRoom), 4, true)
          : new three.BufferAttribute(new Float32Array(this.vertexRoom), 1);
      attribute.setUsage(three.DynamicDrawUsage);
      this.attributes[name] = attribute;
      this.geometry.setAttribute(name, attribute);
    }
    return attribute;
  }

  private dropEdges() {
    if (this.edgeGeometry) release(this.edgeGeometry, Object.values(this.attributes));
    this.edgeGeometry = this.edgeIndex = null;
  }

  private makeEdges() {
    this.dropEdges();
    if (this.triangleRoom === 0) return;
    this.edgeIndex = new three.BufferAttribute(new Uint32Array(6 * this.triangleRoom), 1);
    this.edgeIndex.setUsage(three.DynamicDrawUsage);
    this.edgeGeometry = new three.BufferGeometry();
    this.edgeGeometry.setIndex(this.edgeIndex);
    this.edgeGeometry.setAttribute('position', this.attributes.position!);
    this.edges.geometry = this.edgeGeometry;
    this.writeEdges(new Uint32Array([0, this.triangleSlots]));
  }

  private writeEdges(ranges: Uint32Array) {
    const to = this.edgeIndex!.array as Uint32Array,
      from = this.index.array;
    for (let r = 0; r < ranges.length; r += 2) {
      for (let t = ranges[r]!; t < ranges[r + 1]!; ++t) {
        const a = from[3 * t]!,
          b = from[3 * t + 1]!,
          c = from[3 * t + 2]!;
        to.set([a, b, b, c, c, a], 6 * t);
      }
      this.edgeIndex!.addUpdateRange(6 * ranges[r]!, 6 * (ranges[r + 1]! - ranges[r]!));
    }
    this.edgeIndex!.needsUpdate = true;
    this.edgeGeometry!.setDrawRange(0, 6 * this.triangleSlots);
  }
}
