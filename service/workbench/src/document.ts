// The text of a design and the data in it: read as the service's reader of documents reads it, changed in its places.

import { Alias, type Document, isAlias, isCollection, isMap, isScalar, isSeq, type Node, type Pair, parseDocument, type Scalar, type ScalarTag, type Tags, visit, Document as YamlDocument } from "yaml";

export type Path = (string | number)[];
export type Json = any; // a design as plain data: the service says what is wrong with it, field by field
export interface Edit {
  path: Path;
  value: Json; // undefined: the field goes
}
interface Mark {
  message: string;
  from: number;
  to: number;
}
export interface Parsed {
  document: Document;
  data: Json; // null where there are errors
  errors: Mark[];
  empty: (Mark & { path: Path })[]; // fields without a value: they count as if they were not there
}

// --- reading -------------------------------------------------------------------------------------------------------

const MOST_NODES = 50_000, DEEPEST = 24; // as the service reads: aliases count at the size of what they stand for

// Numbers as the service takes them: with leading zeros, octal or hexadecimal they are texts
const NUMBERS: Record<string, RegExp> = {
  int: /^[-+]?(?:0|[1-9][0-9]*)$/,
  float: /^[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)\.[0-9]*)$/,
  EXP: /^[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)(?:\.[0-9]*)?)[eE][-+]?[0-9]+$/,
};

/** The types of a text, and how it spaces brackets: what is written into it is written so. */
const schemaOf = (source: string) => (tags: Tags): Tags => tags.flatMap((tag: any) => {
  const kind = String(tag.tag).split(":").pop()!, padding = (spaced: boolean) => ({
    ...tag, stringify: (node: any, ctx: any, ...more: unknown[]) => node.toString({ ...ctx, flowCollectionPadding: spaced ? " " : "" }, ...more),
  });
  if (kind === "map") return padding(!/\{[^\s}]/.test(source));
  if (kind === "seq") return padding(/\[ /.test(source));
  if (tag.format === "OCT" || tag.format === "HEX") return [];
  const test = NUMBERS[tag.format ?? kind];
  return test && !(tag as ScalarTag).test?.test(".nan") ? { ...tag, test } : tag;
});

const optionsOf = (source: string) => ({ keepSourceTokens: false, version: "1.2" as const, customTags: schemaOf(source) });

class Unreadable extends Error {
  constructor(message: string, readonly node: Node | null) {
    super(message);
  }
}

const TOO_DEEP = "It is nested too deep for a design.";
const words = ({ code, message }: { code: string; message: string }) =>
  code === "MULTIPLE_DOCS" ? "There are several documents in it; a design is one." : /call stack/.test(message) ? TOO_DEEP : message.split("\n")[0];

export const SEATS = ["structure_connector", "connector_flange"]; // interfaces of a design

export function parse(source: string): Parsed {
  const empty: Parsed["empty"] = [];
  let document = new YamlDocument(null) as unknown as Document, errors: Mark[], data: Json = null;
  try {
    document = parseDocument(source, optionsOf(source)) as unknown as Document;
    errors = document.errors.map((e) => ({ message: words(e), from: e.pos[0], to: e.pos[1] }));
    if (!errors.length) data = read(document, empty);
  } catch (error) {
    const [from, to] = (error instanceof Unreadable && error.node?.range) || [0, 0];
    errors = [{ message: error instanceof Unreadable ? error.message : TOO_DEEP, from, to }];
  }
  return { document, data: errors.length ? null : data, errors, empty };
}

function read(document: Document, empty: Parsed["empty"]): Json {
  const finished = new Map<string, { data: Json; size: number }>(); // what has an anchor and is complete
  let count = 0;
  const refuse = (node: Node | null, words: string): never => { throw new Unreadable(words, node); };
  const add = (node: Node, size: number, path: Path) => {
    count += size;
    if (count > MOST_NODES || path.length > DEEPEST) refuse(node, `A design has at most ${MOST_NODES} values, ${DEEPEST} levels deep; aliases count at the size of what they stand for.`);
  };
  const take = (node: Node, path: Path): Json => {
    if (isAlias(node)) {
      const known = finished.get(node.source) ?? refuse(node, `*${node.source} stands for nothing: no finished value above it has the anchor &${node.source}.`);
      add(node, 1 + known.size, path);
      return known.data;
    }
    const begin = count;
    add(node, 1, path);
    if ((node as Scalar).tag) refuse(node, "YAML tags, which begin with !, are not taken: take it away.");
    const data = isMap(node) ? Object.fromEntries(node.items.map((pair) => takePair(pair as Pair<Node, Node | null>, path)))
      : isSeq(node) ? node.items.map((item, k) => take(item as Node, [...path, k])) : (node as Scalar).value;
    if ((node as Scalar).anchor) finished.set((node as Scalar).anchor!, { data, size: count - begin });
    return typeof data === "number" ? data + 0 : data; // a zero has no sign
  };
  const takePair = ({ key, value }: Pair<Node, Node | null>, path: Path): [string, Json] => {
    const name = isScalar(key) ? key.value : null;
    if (typeof name !== "string") return refuse(key, "The name of a field is a text: put it in quotes.");
    if (name === "__proto__") refuse(key, "There is no field __proto__.");
    const at = [...path, name];
    if (isScalar(value) && value.value === null && !value.source) empty.push({ path: at, message: `Nothing is stated here: it counts as if there were no ${name}.`, from: key.range![0], to: key.range![1] });
    return [name, value ? take(value, at) : null];
  };
  const root = document.contents as Node | null;
  if (!root || (isScalar(root) && root.value === null)) return refuse(root, "The text is empty: a design is a mapping with views, fiducials, targets.");
  const data = take(root, []);
  return isMap(root) ? data : refuse(root, "This is no design: a design is a mapping with views, fiducials, targets.");
}

// --- plain data ----------------------------------------------------------------------------------------------------

const plain = (value: Json) => value !== null && typeof value === "object" && !Array.isArray(value);

/** Whether two values say the same. */
export function equal(a: Json, b: Json): boolean {
  if (a === b || (a !== a && b !== b)) return true;
  if (Array.isArray(a) && Array.isArray(b)) return a.length === b.length && a.every((part, k) => equal(part, b[k]));
  return plain(a) && plain(b) && Object.keys({ ...a, ...b }).every((key) => equal(a[key], b[key]));
}

/** Plain data with edits, sharing whatever they do not touch. */
export function withEdits(data: Json, edits: readonly Edit[]): Json {
  return edits.reduce((all, edit) => withValue(all, edit.path, edit.value), data);
}

function withValue(data: Json, path: Path, value: Json): Json {
  if (!path.length) return value;
  const [key, ...rest] = path;
  const copy: Json = Array.isArray(data) ? [...data] : { ...(data ?? (typeof key === "number" ? [] : {})) };
  const next = rest.length ? withValue(copy[key], rest, value) : value;
  if (next !== undefined) copy[key] = next;
  else if (Array.isArray(copy)) copy.splice(Number(key), 1);
  else delete copy[key];
  return copy;
}

export const pointerOf = (path: Path): string => path.map((part) => `/${String(part).replace(/~/g, "~0").replace(/\//g, "~1")}`).join("");

export function valueAt(data: Json, path: Path): Json {
  return path.reduce((part, key) => (part === null || part === undefined ? undefined : part[key]), data);
}

/** Edits that make one plain value of another; lists of equal length item by item. */
export function differences(before: Json, after: Json, path: Path = []): Edit[] {
  if (equal(before, after)) return [];
  if (plain(before) && plain(after)) {
    return Object.keys({ ...before, ...after }).flatMap((key) => differences(before[key], after[key], [...path, key]));
  }
  if (Array.isArray(before) && Array.isArray(after) && before.length === after.length) {
    return before.flatMap((part, k) => differences(part, after[k], [...path, k]));
  }
  return [{ path, value: after }];
}

/** Numbers that JSON does not have, with their pointers: it would say null for them, which means "not stated". */
export function notFinite(data: Json, pointer = ""): { pointer: string; value: number }[] {
  if (typeof data === "number") return Number.isFinite(data) ? [] : [{ pointer, value: data }];
  if (data === null || typeof data !== "object") return [];
  return Object.entries(data).flatMap(([name, part]) => notFinite(part, pointer + pointerOf([name])));
}

// --- writing -------------------------------------------------------------------------------------------------------

/** The text after edits: what they do not change stays as it is written.  ``spelled``: places where an alias stood, and
 * now what it stood for, because it is no longer the same.  Throws where the text cannot be made to say it. */
export function writeEdits(source: string, edits: readonly Edit[]): { text: string; spelled: Path[] } {
  const { document, data } = parse(source), wanted = withEdits(data, edits), spelled: Path[] = [];
  const quick = writeInPlace(source, document, edits);
  if (quick !== null && equal(parse(quick).data, wanted)) return { text: quick, spelled };
  for (const edit of edits) {
    spellOut(document, edit.path, spelled);
    writeEdit(document, edit.path, edit.value);
  }
  followAnchors(document, wanted, spelled);
  const text = textOf(document);
  if (!equal(parse(text).data, wanted)) throw new Error("the text would say something else");
  return { text, spelled };
}

// Signs that are not shown as what they are: the service reads them as escapes in double quotes
const UNSEEN = /[\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ufffe\uffff]/g;

function textOf(document: Document): string {
  visit(document, { Scalar: (_, node) => { if (typeof node.value === "string" && node.value.search(UNSEEN) >= 0) node.type = "QUOTE_DOUBLE"; } });
  return document.toString({ lineWidth: 120 }).replace(UNSEEN, (sign) => `\\u${sign.charCodeAt(0).toString(16).padStart(4, "0")}`);
}

/** The text with other numbers in their places, without the lines of items that go, and every other character as it was;
 * null where more is to be changed. */
function writeInPlace(source: string, document: Document, edits: readonly Edit[]): string | null {
  const changes: [number, number, string][] = [];
  const put = (node: unknown, value: Json): boolean => {
    if (Array.isArray(value)) return isSeq(node) && node.items.length === value.length && value.every((part, k) => put(node.items[k], part));
    if (!isScalar(node) || (typeof value !== "number" && typeof value !== "boolean")) return false;
    if (node.value === value) return true;
    const [from, to] = node.range ?? [0, 0];
    changes.push([from, to, String(value)]);
    return from < to;
  };
  const drop = (list: unknown, k: number): boolean => {
    const [from, to] = (isSeq(list) && (list.items[k] as Node | undefined)?.range) || [0, 0], begin = source.lastIndexOf("\n", from - 1) + 1;
    const end = source.indexOf("\n", to) + 1 || source.length;
    if (!isSeq(list) || list.items.length < 2 || !/^ *- +$/.test(source.slice(begin, from)) || source.slice(from, to).includes("\n")) return false;
    changes.push([begin, end, ""]);
    return true;
  };
  const make = ({ path, value }: Edit) => (value === undefined ? drop(document.getIn(path.slice(0, -1), true), Number(path[path.length - 1])) : put(document.getIn(path, true), value));
  if (!edits.every(make)) return null;
  return changes.sort((a, b) => b[0] - a[0]).reduce((text, [from, to, value]) => text.slice(0, from) + value + text.slice(to), source);
}

/** What aliases on the way to a place stand for, in their places. */
function spellOut(document: Document, path: Path, spelled: Path[]): void {
  for (let k = 1; k < path.length; k += 1) {
    const at = path.slice(0, k), node = document.getIn(at, true);
    if (!isAlias(node)) continue;
    const copy = node.resolve(document)!.clone() as Node;
    delete copy.comment;
    visit(copy, { Node: (_, inside) => { if (!(inside instanceof Alias)) delete inside.anchor; } });
    document.setIn(at, copy);
    spelled.push(at);
  }
}

/** Aliases of a value that has become another one: what they stood for is written in their places. */
function followAnchors(document: Document, wanted: Json, spelled: Path[]): void {
  const now = new Map<string, Json>();
  const walk = (node: unknown, value: Json, path: Path, put: (node: Node) => void) => {
    if (isAlias(node)) {
      if (now.has(node.source) && equal(now.get(node.source), value)) return;
      const copy = document.createNode(value) as Node;
      flow(copy);
      put(copy);
      spelled.push(path);
      return;
    }
    if (isMap(node)) for (const pair of node.items as Pair<Scalar | string, Node>[]) {
      const name = String(isScalar(pair.key) ? pair.key.value : pair.key);
      walk(pair.value, value[name], [...path, name], (copy) => (pair.value = copy));
    }
    if (isSeq(node)) node.items.forEach((item, k) => walk(item, value[k], [...path, k], (copy) => (node.items[k] = copy)));
    if ((isScalar(node) || isCollection(node)) && node.anchor) now.set(node.anchor, value);
  };
  walk(document.contents, wanted, [], () => undefined);
}

function writeEdit(document: Document, path: Path, value: Json): void {
  const old: any = document.getIn(path, true);
  if (value === undefined) {
    document.deleteIn(path);
  } else if (Array.isArray(value) && isSeq(old) && old.items.length === value.length) {
    value.forEach((part, k) => writeEdit(document, [...path, k], part));
  } else if (value !== null && typeof value === "object" && !Array.isArray(value) && isMap(old)) {
    for (const item of [...old.items]) {
      const key = String(isScalar(item.key) ? item.key.value : item.key);
      if (!(key in value)) document.deleteIn([...path, key]);
    }
    for (const [key, part] of Object.entries(value)) writeEdit(document, [...path, key], part);
  } else if (isScalar(old) && (value === null || typeof value !== "object")) {
    if (old.value === value) return;
    old.value = value;
    delete (old as { source?: string }).source;
    delete (old as { format?: string }).format;
    delete (old as { minFractionDigits?: number }).minFractionDigits;
  } else {
    const node = document.createNode(value);
    flow(node);
    const parent: any = document.getIn(path.slice(0, -1), true);
    if (isCollection(parent) && isSeq(parent) && parent.items.length === path[path.length - 1]) parent.add(node);
    else document.setIn(path, node);
  }
}

/** Plain data as YAML that people like to read. */
export function writeYaml(data: Json): string {
  const document = new YamlDocument(data, optionsOf(""));
  flow(document.contents);
  return textOf(document as unknown as Document);
}

/** Short lists of numbers, and maps of scalars in a list, on one line, as people write them. */
function flow(node: any): void {
  if (!isCollection(node)) return;
  for (const item of node.items as any[]) flow(item.value !== undefined && item.key !== undefined ? item.value : item);
  if (isSeq(node) && node.items.every((item) => isScalar(item))) node.flow = true;
  if (isMap(node)) node.flow = node.items.every((item: any) => isScalar(item.value) || item.value?.flow) && JSON.stringify(node).length < 90;
}
