// The carrier's surface: triangles of an STL file, the nearest point of them, a ball that comes to touch them, and their
// picture.  Weighed instead: three.js with three-mesh-bvh, whose loader, search and renderer do the same in some hundred
// kilobytes, and whose picture needs WebGL; a carrier has some 10^4 triangles, which is little enough without.

import { add, cross, dot, length, type Vector } from "./geometry";

/** corners: nine numbers a triangle, mm. */
export interface Mesh {
  corners: Float64Array;
  low: Vector;
  high: Vector;
}
const MOST = 1_000_000; // triangles

/** The triangles of an STL file, binary or text; its unit is taken for mm.  Throws where it is none. */
export function readStl(content: ArrayBuffer): Mesh {
  const view = new DataView(content), count = content.byteLength >= 84 ? view.getUint32(80, true) : 0, numbers: number[] = [];
  const binary = count > 0 && content.byteLength === 84 + 50 * count;
  if (binary && count <= MOST) for (let k = 0; k < count; k += 1) for (let n = 0; n < 9; n += 1) numbers.push(view.getFloat32(96 + 50 * k + 4 * n, true));
  else if (!binary) for (const [, x, y, z] of new TextDecoder().decode(content).matchAll(/^\s*vertex\s+(\S+)\s+(\S+)\s+(\S+)\s*$/gim)) numbers.push(Number(x), Number(y), Number(z));
  if ((binary ? count : numbers.length / 9) > MOST) throw new Error(`it has more than ${MOST.toLocaleString("en")} triangles: export it coarser`);
  if (!numbers.length || numbers.length % 9) throw new Error("it holds no triangles: an STL file was expected, binary or text");
  if (!numbers.every((value) => Math.abs(value) < 1e6)) throw new Error("a corner in it is no number, or farther than 1 km");
  return meshOf(Float64Array.from(numbers));
}

/** Without triangles that have no area. */
export function meshOf(all: Float64Array): Mesh {
  const kept = new Float64Array(all.length), low: Vector = [Infinity, Infinity, Infinity], high: Vector = [-Infinity, -Infinity, -Infinity];
  let end = 0;
  for (let k = 0; k < all.length; k += 9) {
    const [a, b, c] = corner3(all, k / 9);
    if (length(cross(add(b, a, -1), add(c, a, -1))) < 1e-12) continue;
    kept.set(all.subarray(k, k + 9), end);
    end += 9;
    for (const p of [a, b, c]) for (const axis of [0, 1, 2]) [low[axis], high[axis]] = [Math.min(low[axis], p[axis]), Math.max(high[axis], p[axis])];
  }
  if (!end) throw new Error("none of its triangles has an area");
  return { corners: kept.slice(0, end), low, high };
}

const corner3 = (corners: Float64Array, triangle: number) => [0, 3, 6].map((n) => [...corners.subarray(9 * triangle + n, 9 * triangle + n + 3)] as Vector);

// --- the nearest point -----------------------------------------------------------------------------------------------

/** Boxes about triangles, each half of the one above it.  A node: six ends of its box; children at 2 k + 1, 2 k + 2. */
export interface Tree {
  mesh: Mesh;
  order: Int32Array;
  boxes: Float64Array;
  leaves: number; // how many nodes the last level has
}

export function treeOf(mesh: Mesh): Tree {
  const count = mesh.corners.length / 9, leaves = 2 ** Math.ceil(Math.log2(Math.max(1, count / 4))), order = Int32Array.from({ length: count }, (_, k) => k);
  const boxes = new Float64Array(6 * (2 * leaves - 1)), { corners } = mesh;
  const sums = Float64Array.from({ length: 3 * count }, (_, k) => [0, 3, 6].reduce((sum, n) => sum + corners[9 * Math.floor(k / 3) + (k % 3) + n], 0));
  const build = (node: number, from: number, to: number) => {
    const box = boxes.subarray(6 * node, 6 * node + 6).fill(Infinity, 0, 3).fill(-Infinity, 3);
    for (let k = from; k < to; k += 1) for (let n = 0; n < 9; n += 1) {
      const value = corners[9 * order[k] + n], axis = n % 3;
      if (value < box[axis]) box[axis] = value;
      if (value > box[axis + 3]) box[axis + 3] = value;
    }
    if (node >= leaves - 1) return;
    const wide = [0, 1, 2].map((k) => box[k + 3] - box[k]), axis = wide.indexOf(Math.max(...wide)), middle = (from + to) >> 1;
    order.subarray(from, to).sort((a, b) => sums[3 * a + axis] - sums[3 * b + axis]);
    build(2 * node + 1, from, middle);
    build(2 * node + 2, middle, to);
  };
  build(0, 0, count);
  return { mesh, order, boxes, leaves };
}

/** How far a box is from a point, squared. */
function boxAway(boxes: Float64Array, node: number, p: Vector): number {
  let sum = 0;
  for (let k = 0; k < 3; k += 1) {
    const off = Math.max(boxes[6 * node + k] - p[k], 0, p[k] - boxes[6 * node + k + 3]);
    sum += off * off;
  }
  return sum;
}

/** The point of the surface that is nearest, and its triangle. */
export function nearest({ mesh, order, boxes, leaves }: Tree, p: Vector): { point: Vector; away: number; triangle: number } {
  let best = Infinity, point = p, triangle = 0;
  const count = order.length;
  const search = (node: number, from: number, to: number) => {
    if (boxAway(boxes, node, p) >= best) return;
    if (node < leaves - 1) {
      const middle = (from + to) >> 1, left = 2 * node + 1, first = boxAway(boxes, left, p) <= boxAway(boxes, left + 1, p);
      if (first) search(left, from, middle);
      search(left + 1, middle, to);
      if (!first) search(left, from, middle);
      return;
    }
    for (let k = from; k < to; k += 1) {
      const found = onTriangle(corner3(mesh.corners, order[k]), p), off = add(found, p, -1), away = dot(off, off);
      if (away < best) [best, point, triangle] = [away, found, order[k]];
    }
  };
  search(0, 0, count);
  return { point, away: Math.sqrt(best), triangle };
}

/** The nearest point of a triangle, by the region of its plane in which the point lies (Ericson, Real-Time Collision
 * Detection, 2005, 5.1.5). */
function onTriangle([a, b, c]: Vector[], p: Vector): Vector {
  const ab = add(b, a, -1), ac = add(c, a, -1), ap = add(p, a, -1), bp = add(p, b, -1), cp = add(p, c, -1);
  const d1 = dot(ab, ap), d2 = dot(ac, ap), d3 = dot(ab, bp), d4 = dot(ac, bp), d5 = dot(ab, cp), d6 = dot(ac, cp);
  if (d1 <= 0 && d2 <= 0) return a;
  if (d3 >= 0 && d4 <= d3) return b;
  const vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return add(a, ab, d1 / (d1 - d3));
  if (d6 >= 0 && d5 <= d6) return c;
  const vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return add(a, ac, d2 / (d2 - d6));
  const va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) return add(b, add(c, b, -1), (d4 - d3) / (d4 - d3 + d5 - d6));
  return add(add(a, ab, vb / (va + vb + vc)), ac, vc / (va + vb + vc));
}

// --- a ball that touches ---------------------------------------------------------------------------------------------

const EXACT = 1e-7; // mm

/** The centre of a ball that touches the surface, near to a centre: where it cuts it, pushed out the way it lies. */
export function touch(tree: Tree, centre: Vector, radius: number): Vector {
  for (let k = 0, at = centre; ; k += 1) {
    const { point, away, triangle } = nearest(tree, at);
    if (Math.abs(away - radius) < EXACT || k === 100) return at;
    const [a, b, c] = corner3(tree.mesh.corners, triangle), normal = cross(add(b, a, -1), add(c, a, -1));
    const way = away > 1e-9 ? add(at, point, -1) : normal; // on the surface itself: the way its triangle faces
    at = add(point, way, radius / length(way));
  }
}

/** The centre of a ball that flies along a unit vector until it touches; of one that would miss, where it comes nearest.
 * Sphere tracing: what is nearest is farther than that, so that far it flies freely. */
export function cast(tree: Tree, through: Vector, way: Vector, radius: number): Vector {
  const { low, high } = tree.mesh, size = length(add(high, low, -1)) + 2 * radius, middle = add(low, high).map((v) => v / 2) as Vector;
  const begin = add(through, way, dot(add(middle, through, -1), way) - size);
  let least = Infinity, best = begin;
  for (let k = 0, far = 0; k < 2000 && far < 2 * size; k += 1) {
    const at = add(begin, way, far), gap = nearest(tree, at).away - radius;
    if (gap < least) [least, best] = [gap, at];
    if (gap < EXACT) break;
    far += Math.max(gap, 1e-4);
  }
  return touch(tree, best, radius);
}

/** The centre after a step along the surface: in pieces that are too short to come through it. */
export function walk(tree: Tree, from: Vector, step: Vector, radius: number): Vector {
  const pieces = Math.ceil((2 * length(step)) / radius);
  let at = touch(tree, from, radius);
  for (let k = 0; k < pieces; k += 1) at = touch(tree, add(at, step, 1 / pieces), radius);
  return at;
}

// --- its picture -----------------------------------------------------------------------------------------------------

/** From where it is seen, as the viewer says it: right and up in con, mm to pixels, and what is in the middle. */
export interface Seen {
  right: Vector;
  up: Vector;
  scale: number;
  centre: Vector;
  width: number;
  height: number;
}
const SHADE = [86, 104, 118], ALPHA = 120; // of a face that looks at the eye

/** RGBA of each pixel: faces lighter the more they look away, the nearest before the others. */
export function picture(mesh: Mesh, { right, up, scale, centre, width, height }: Seen): Uint8ClampedArray<ArrayBuffer> {
  const eye = cross(right, up), pixels = new Uint8ClampedArray(4 * width * height), deep = new Float32Array(width * height).fill(-Infinity), { corners } = mesh;
  const [cx, cy] = [width / 2 - scale * dot(centre, right), height / 2 + scale * dot(centre, up)];
  const x = new Float64Array(3), y = new Float64Array(3), z = new Float64Array(3); // pixels, z towards the eye
  for (let k = 0; k < corners.length; k += 9) {
    for (let n = 0; n < 3; n += 1) {
      const at = k + 3 * n, p = corners[at], q = corners[at + 1], r = corners[at + 2];
      x[n] = cx + scale * (p * right[0] + q * right[1] + r * right[2]);
      y[n] = cy - scale * (p * up[0] + q * up[1] + r * up[2]);
      z[n] = scale * (p * eye[0] + q * eye[1] + r * eye[2]);
    }
    const ax = x[1] - x[0], ay = y[1] - y[0], az = z[1] - z[0], bx = x[2] - x[0], by = y[2] - y[0], bz = z[2] - z[0], area = ax * by - bx * ay;
    const x0 = Math.max(0, Math.ceil(Math.min(x[0], x[1], x[2]) - 0.5)), x1 = Math.min(width - 1, Math.floor(Math.max(x[0], x[1], x[2]) - 0.5));
    const y0 = Math.max(0, Math.ceil(Math.min(y[0], y[1], y[2]) - 0.5)), y1 = Math.min(height - 1, Math.floor(Math.max(y[0], y[1], y[2]) - 0.5));
    if (x0 > x1 || y0 > y1 || Math.abs(area) < 1e-9) continue;
    const shade = 0.35 + (0.65 * Math.abs(area)) / Math.hypot(ay * bz - az * by, az * bx - ax * bz, area), [red, green, blue] = SHADE.map((tone) => 255 - (255 - tone) * shade);
    for (let j = y0; j <= y1; j += 1) for (let i = x0, at = j * width + x0; i <= x1; i += 1, at += 1) {
      const right_ = i + 0.5 - x[0], down = j + 0.5 - y[0], v = (right_ * by - bx * down) / area, w = (ax * down - right_ * ay) / area, depth = z[0] + v * az + w * bz;
      if (v < 0 || w < 0 || v + w > 1 || depth <= deep[at]) continue;
      deep[at] = depth;
      pixels[4 * at] = red;
      pixels[4 * at + 1] = green;
      pixels[4 * at + 2] = blue;
      pixels[4 * at + 3] = ALPHA;
    }
  }
  return pixels;
}
