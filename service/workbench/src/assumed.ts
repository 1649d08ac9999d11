// What nobody stated: the list `assumed` of a design, as the service reads it (solver/tailstack/design/loading.py).
// A pointer to a mapping, or to a list of mappings, covers every number below it; stating a value takes it off.

import { type Edit, equal, type Json, type Path, pointerOf, valueAt, withEdits } from "./document";

const pathOf = (pointer: string): Path => pointer.split("/").slice(1).map((step) => step.replace(/~1/g, "/").replace(/~0/g, "~"));
const at = (data: Json, pointer: string): Json => valueAt(data, pathOf(pointer));
const covers = (pointer: string, other: string) => other === pointer || other.startsWith(`${pointer}/`);

const isMapping = (node: Json) => node !== null && typeof node === "object" && !Array.isArray(node);
const isValue = (node: Json) => !isMapping(node) && !(Array.isArray(node) && node.some(isMapping));
const isNumeric = (node: Json): boolean => (Array.isArray(node) ? node.length > 0 && node.every(isNumeric) : typeof node === "number");
const children = (node: Json, pointer: string) => (node !== null && typeof node === "object" ? Object.keys(node).map((key) => pointer + pointerOf([key])) : []);

function numbersBelow(data: Json, pointer: string): string[] {
  const node = at(data, pointer);
  return isValue(node) ? (isNumeric(node) ? [pointer] : []) : children(node, pointer).flatMap((way) => numbersBelow(data, way));
}

const entries = (data: Json): string[] => (Array.isArray(data?.assumed) ? data.assumed.filter((pointer: Json) => typeof pointer === "string" && at(data, pointer) !== undefined) : []);

/** A pointer to each assumed value. */
export function listAssumed(data: Json): string[] {
  const below = (pointer: string) => (isValue(at(data, pointer)) ? [] : numbersBelow(data, pointer));
  return [...new Set(entries(data).flatMap((pointer) => (below(pointer).length ? below(pointer) : [pointer])))];
}

/** The pointers without a value that was stated; what else a pointer covers stays. */
function leave(data: Json, pointers: string[], stated: string): string[] {
  return pointers.flatMap((pointer) => {
    if (covers(stated, pointer)) return [];
    if (!covers(pointer, stated)) return [pointer];
    if (isValue(at(data, pointer))) return [];
    return leave(data, children(at(data, pointer), pointer).filter((way) => numbersBelow(data, way).length > 0), stated);
  });
}

/** Where the items of a list stand when one of them has gone. */
function without(pointers: string[], gone: string): string[] {
  const [, list, k] = /^(.*)\/(\d+)$/.exec(gone)!, item = new RegExp(`^${list.replace(/[.*+?^${}()|[\]\\]/g, "\\$&")}/(\\d+)(?=/|$)`);
  return pointers.filter((pointer) => !covers(gone, pointer)).map((pointer) => pointer.replace(item, (same, index) => (Number(index) > Number(k) ? `${list}/${Number(index) - 1}` : same)));
}

/** The edits, and with them what they take off the list: what they change, and what they say again. */
export function stating(data: Json, edits: readonly Edit[]): Edit[] {
  if (!Array.isArray(data?.assumed) || edits.some(({ path }) => path[0] === "assumed")) return [...edits];
  let now = data, left = entries(data);
  for (const edit of edits) {
    const after = withEdits(now, [edit]), pointer = pointerOf(edit.path);
    if (edit.value === undefined && Array.isArray(valueAt(now, edit.path.slice(0, -1)))) left = without(left, pointer);
    else {
      for (const each of listAssumed({ ...now, assumed: left })) if (!equal(at(now, each), at(after, each))) left = leave(now, left, each);
      if (isValue(valueAt(now, edit.path))) left = leave(now, left, pointer);
    }
    now = after;
  }
  return [...edits, ...listEdits(data.assumed, left)];
}

/** Edits of the list alone: someone says that a value is as it stands there. */
export const confirming = (data: Json, pointer: string): Edit[] => listEdits(data.assumed, leave(data, entries(data), pointer));

/** Entries that go are taken out line by line where nothing else changes; an empty list goes as a whole. */
function listEdits(before: string[], left: string[]): Edit[] {
  if (equal(before, left)) return [];
  if (!left.length) return [{ path: ["assumed"], value: undefined }];
  const gone = before.flatMap((pointer, k) => (left.includes(pointer) ? [] : [k])).reverse();
  const kept = before.filter((pointer) => left.includes(pointer));
  return equal(kept, left) ? gone.map((k) => ({ path: ["assumed", k], value: undefined })) : [{ path: ["assumed"], value: left }];
}
