// The design on the page: its text, what was done to it, and how it is kept.
//
// The YAML text is the truth, so that comments, order and the way numbers are written survive every change.  A gesture
// (a drag, a slide) is a list of edits that is laid over the parsed text, and becomes one step of the history when it
// ends.

import { batch, computed, signal } from "@preact/signals";
import { Document, isCollection, isMap, isScalar, isSeq, parseDocument } from "yaml";

export type Path = (string | number)[];
export type Json = any; // a design as plain data: the service says what is wrong with it, field by field
export interface Edit {
  path: Path;
  value: Json; // undefined: the field goes
}
interface Step {
  text: string;
  what: string;
}
export interface Variant {
  name: string;
  text: string;
}

const YAML = { keepSourceTokens: false, version: "1.2" as const };
const AUTOSAVE = "tailstack.workbench.design", VARIANTS = "tailstack.workbench.variants";
const MOST_STEPS = 300;

export const steps = signal<Step[]>([]);
export const position = signal(-1);
export const gesture = signal<Edit[]>([]);
export const variants = signal<Variant[]>(recall(VARIANTS, []));
export const selected = signal<string | null>(null); // label of a fiducial
export const opened = signal(0); // designs opened so far: what was found of one says nothing of the next
export const shownPointer = signal<string | null>(null); // a place that is to be shown in the text
export const savedSteps = signal(true);

export const text = computed(() => steps.value[position.value]?.text ?? "");
const parsed = computed(() => parse(text.value));
/** The design as plain data, with the gesture that is under way.  The same object as long as nothing has changed. */
export const design = computed<Json>(() => withEdits(parsed.value.data, gesture.value));
export const canUndo = computed(() => position.value > 0);
export const canRedo = computed(() => position.value < steps.value.length - 1);

export function parse(source: string): { document: Document; data: Json; errors: { message: string; from: number; to: number }[] } {
  const document = parseDocument(source, YAML) as unknown as Document;
  const errors = document.errors.map((e) => ({ message: e.code === "MULTIPLE_DOCS" ? "There are several documents in it; a design is one." : e.message.split("\n")[0], from: e.pos[0], to: e.pos[1] }));
  return { document, data: errors.length ? null : document.toJS(), errors };
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

export function valueAt(data: Json, path: Path): Json {
  return path.reduce((part, key) => (part === null || part === undefined ? undefined : part[key]), data);
}

/** The text after edits: numbers change in their places, what is new is written below what is there. */
export function writeEdits(source: string, edits: readonly Edit[]): string {
  const document = parse(source).document;
  for (const edit of edits) writeEdit(document, edit.path, edit.value);
  return document.toString({ lineWidth: 120, flowCollectionPadding: true });
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
  const document = new Document(data);
  flow(document.contents);
  return document.toString({ lineWidth: 120, flowCollectionPadding: true });
}

/** Short lists of numbers, and maps of scalars in a list, on one line, as people write them. */
function flow(node: any): void {
  if (!isCollection(node)) return;
  for (const item of node.items as any[]) flow(item.value !== undefined && item.key !== undefined ? item.value : item);
  if (isSeq(node) && node.items.every((item) => isScalar(item))) node.flow = true;
  if (isMap(node)) node.flow = node.items.every((item: any) => isScalar(item.value) || item.value?.flow) && JSON.stringify(node).length < 90;
}

/** Edits that make one plain value of another; lists of equal length item by item. */
export function differences(before: Json, after: Json, path: Path = []): Edit[] {
  if (Object.is(before, after)) return [];
  const plain = (v: Json) => v !== null && typeof v === "object" && !Array.isArray(v);
  if (plain(before) && plain(after)) {
    const keys = [...new Set([...Object.keys(before), ...Object.keys(after)])];
    return keys.flatMap((key) => differences(before[key], after[key], [...path, key]));
  }
  if (Array.isArray(before) && Array.isArray(after) && before.length === after.length) {
    return before.flatMap((part, k) => differences(part, after[k], [...path, k]));
  }
  return JSON.stringify(before) === JSON.stringify(after) ? [] : [{ path, value: after }];
}

/** RFC 7396: what merged into ``before`` gives ``after``; lists are replaced whole. */
export function mergePatch(before: Json, after: Json): Json {
  const patch: Json = {};
  for (const key of new Set([...Object.keys(before), ...Object.keys(after)])) {
    const [a, b] = [before[key], after[key]];
    if (a === b) continue;
    if (b === undefined) patch[key] = null;
    else if ([a, b].every((v) => v !== null && typeof v === "object" && !Array.isArray(v))) {
      const part = mergePatch(a, b);
      if (Object.keys(part).length) patch[key] = part;
    } else if (JSON.stringify(a) !== JSON.stringify(b)) patch[key] = b;
  }
  return patch;
}

// --- what a person does --------------------------------------------------------------------------------------

/** A new text as a step that can be undone.  ``merge``: as part of the last step, if that was the same kind. */
export function commit(source: string, what: string, merge = false): void {
  if (source === text.value) return;
  batch(() => {
    let kept = steps.value.slice(0, position.value + 1);
    if (merge && kept.length > 1 && kept[kept.length - 1].what === what) kept = kept.slice(0, -1);
    steps.value = [...kept, { text: source, what }].slice(-MOST_STEPS);
    position.value = steps.value.length - 1;
    gesture.value = [];
  });
  autosave();
}

export function edit(edits: Edit[], what: string, merge = false): void {
  commit(writeEdits(text.value, edits), what, merge);
}

/** Show edits of a gesture that is still under way. */
export function preview(edits: Edit[]): void {
  gesture.value = edits;
}

export function finishGesture(what: string): void {
  if (gesture.value.length) edit(gesture.value, what);
}

export function cancelGesture(): void {
  if (gesture.value.length) gesture.value = [];
}

export function undo(): void {
  if (gesture.value.length) cancelGesture();
  else if (canUndo.value) position.value -= 1;
  autosave();
}

export function redo(): void {
  if (canRedo.value) position.value += 1;
  autosave();
}

export function open(source: string, what: string): void {
  batch(() => {
    selected.value = null;
    opened.value += 1;
    if (position.value < 0) {
      steps.value = [{ text: source, what }];
      position.value = 0;
    } else commit(source, what);
  });
  autosave();
}

// --- keeping it ----------------------------------------------------------------------------------------------

/** What the browser keeps under a name. */
export function recall<T>(key: string, otherwise: T): T {
  try {
    return JSON.parse(localStorage.getItem(key) ?? "null") ?? otherwise;
  } catch {
    return otherwise;
  }
}

/** Keep it; false where the browser does not. */
export function remember(key: string, value: unknown): boolean {
  try {
    localStorage.setItem(key, JSON.stringify(value));
    return true;
  } catch {
    return false; // full, or not allowed: the page says that nothing is saved
  }
}

// Tabs do not disturb each other: each has its own place, and a new tab begins with what was saved last.
const tab = (() => {
  try {
    const known = sessionStorage.getItem("tailstack.workbench.tab") ?? crypto.randomUUID();
    sessionStorage.setItem("tailstack.workbench.tab", known);
    return known;
  } catch {
    return "only";
  }
})();

function autosave(): void {
  const last = steps.value.slice(Math.max(0, position.value - 40), position.value + 1);
  const kept = { steps: last, position: last.length - 1, at: Date.now() };
  savedSteps.value = remember(`${AUTOSAVE}.${tab}`, kept) && remember(AUTOSAVE, kept);
  for (const key of oldTabs()) localStorage.removeItem(key);
}

function oldTabs(): string[] {
  try {
    const keys = Object.keys(localStorage).filter((key) => key.startsWith(`${AUTOSAVE}.`));
    const times = keys.map((key) => [recall<{ at: number }>(key, { at: 0 }).at, key] as const).sort((a, b) => b[0] - a[0]);
    return times.slice(8).map(([, key]) => key);
  } catch {
    return [];
  }
}

/** What was last on this page, in this tab or another; false where nothing was. */
export function restore(): boolean {
  const kept = recall<{ steps: Step[]; position: number } | null>(`${AUTOSAVE}.${tab}`, recall(AUTOSAVE, null));
  if (!kept?.steps?.length) return false;
  batch(() => {
    steps.value = kept.steps;
    position.value = Math.min(kept.position, kept.steps.length - 1);
  });
  return true;
}

export function keepVariant(): string {
  const used = new Set(variants.value.map((v) => v.name));
  const name = [..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"].find((letter) => !used.has(letter)) ?? `V${variants.value.length + 1}`;
  setVariants([...variants.value, { name, text: text.value }]);
  return name;
}

export function setVariants(next: Variant[]): void {
  variants.value = next;
  remember(VARIANTS, next);
}

// --- the whole design in the link ----------------------------------------------------------------------------

export const LONGEST_LINK = 8000; // characters; longer ones are cut by mail programs and chats

async function through(bytes: Uint8Array, stream: CompressionStream | DecompressionStream): Promise<Uint8Array> {
  const piped = new Blob([bytes as BlobPart]).stream().pipeThrough(stream as unknown as ReadableWritablePair);
  return new Uint8Array(await new Response(piped).arrayBuffer());
}

export async function linkOf(source: string): Promise<string> {
  const packed = await through(new TextEncoder().encode(source), new CompressionStream("deflate-raw"));
  const base64 = btoa(Array.from(packed, (byte) => String.fromCharCode(byte)).join(""));
  return `${location.origin}${location.pathname}#design=${base64.replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "")}`;
}

/** The design that a link holds, or null.  Throws where the link was cut. */
export async function textOfLink(hash: string): Promise<string | null> {
  const found = /^#design=([\w-]+)$/.exec(hash);
  if (!found) return null;
  const bytes = Uint8Array.from(atob(found[1].replace(/-/g, "+").replace(/_/g, "/")), (c) => c.charCodeAt(0));
  return new TextDecoder("utf-8", { fatal: true }).decode(await through(bytes, new DecompressionStream("deflate-raw")));
}
