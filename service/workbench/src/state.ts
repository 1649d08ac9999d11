// The design on the page: its text, what was done to it, and how it is kept.
//
// The YAML text is the truth, so that comments, order and the way numbers are written survive every change.  A gesture
// (a drag, a slide) is a list of edits that is laid over the parsed text, and becomes one step of the history when it
// ends.

import { batch, computed, effect, signal } from "@preact/signals";
import { stating } from "./assumed";
import { type Edit, equal, type Json, parse, withEdits, writeEdits } from "./document";

export { differences, type Edit, type Json, parse, type Path, pointerOf, valueAt, withEdits, writeYaml } from "./document";

interface Step {
  text: string;
  what: string;
  until?: number; // ms since 1970: the same again before then is part of this step
  opens?: boolean; // another design, which is not held against what was there
  drops?: string; // name of a version that is taken away
}
export interface Version {
  name: string;
  note?: string;
  date?: string;
  text: string; // without a review of its own
}

const TAB = "tailstack.workbench.tab", AUTOSAVE = "tailstack.workbench.design";
const MOST_STEPS = 300, MOST_TEXT = 20_000_000; // characters of all of them: each has every version that was kept in it
const MOST_SAVED = 300_000; // characters of one tab: eight tabs and runs share 5 million
export const PRESSES = 1000; // ms between presses of a key that are one step

/** What is said to the person at the page. */
export const message = signal<{ words: string; bad: boolean } | null>(null);
const READ = 15_000; // ms, after which what is no complaint leaves the page
export function say(words: string, bad = false): void {
  const said = { words, bad };
  message.value = said;
  if (!bad) window.setTimeout(() => message.value === said && (message.value = null), READ);
}

export const steps = signal<Step[]>([]);
export const position = signal(-1);
export const gesture = signal<Edit[]>([]);
export const picked = signal<readonly string[]>([]); // labels of the fiducials that are chosen, the one chosen last at the end
/** The one of them that keys move; setting it leaves the others. */
export const selected = {
  get value(): string | null {
    return picked.value[picked.value.length - 1] ?? null;
  },
  set value(label: string | null) {
    if (picked.peek().length !== 1 || picked.peek()[0] !== label) picked.value = label === null ? [] : [label];
  },
};
export const pointed = signal<string | null>(null); // of the one that the pointer is at, wherever that is
export const opened = signal(0); // designs opened so far: what was found of one says nothing of the next
export const shownPointer = signal<string | null>(null); // a place that is to be shown in the text
export const savedSteps = signal(true);
/** What is typed under "As text" and is no YAML yet: it stays there, whatever becomes of the design meanwhile. */
const DRAFT = "tailstack.workbench.draft";
export const draft = signal(recall(DRAFT, "", () => sessionStorage));
effect(() => void remember(DRAFT, draft.value, () => sessionStorage));

export const text = computed(() => steps.value[position.value]?.text ?? "");
const parsed = computed(() => parse(text.value));
/** Why the text is no design that could be looked at. */
export const errors = computed(() => (steps.value.length ? parsed.value.errors : []));
/** The document as plain data, what a review left in it too: what is sent to become a report. */
export const whole = computed<Json>(() => parsed.value.data);
/** The design in it: no number depends on a review, so nothing is asked anew where that alone has changed. */
let last: Json = null;
export const settled = computed<Json>(() => {
  const { review, ...rest } = whole.value ?? {}, found = whole.value && (review === undefined ? whole.value : rest);
  return (last = equal(found, last) ? last : found);
});
/** The same with the gesture that is under way.  The same object as long as nothing has changed. */
export const design = computed<Json>(() => settled.value && withEdits(settled.value, gesture.value));

const listed = (data: Json, name: string): Json[] => (Array.isArray(data?.review?.[name]) ? data.review[name] : []);
export const comments = computed<Json[]>(() => listed(whole.value, "comments"));
const versionsOf = (data: Json): Version[] => listed(data, "versions").filter((each) => typeof each?.name === "string" && typeof each.text === "string");
export const versions = computed(() => versionsOf(whole.value));
export const canUndo = computed(() => position.value > 0);
export const canRedo = computed(() => position.value < steps.value.length - 1);

// --- what a person does --------------------------------------------------------------------------------------

/** A new text as a step that can be undone.  ``within``: ms in which the same kind of change is part of it. */
export function commit(source: string, what: string, within = 0, opens = false): void {
  if (source === text.value) return cancelGesture();
  batch(() => {
    let kept = steps.value.slice(0, position.value + 1);
    const last = kept[kept.length - 1];
    if (within && kept.length > 1 && last.what === what && Date.now() < (last.until ?? 0)) kept = kept.slice(0, -1);
    kept = [...kept, { text: source, what, ...(within && { until: Date.now() + within }), ...(opens && { opens }) }];
    steps.value = fitting([kept[0], ...kept.slice(1).slice(1 - MOST_STEPS)], MOST_TEXT);
    position.value = steps.value.length - 1;
    cancelGesture();
  });
  autosave();
}

/** The first step and the last ones, as many as have room in so many characters, one at least. */
const fitting = (all: Step[], room: number): Step[] => [all[0], ...all.slice(1).reverse().filter(({ text: one }, k) => (room -= one.length) > 0 || k === 0).reverse()];

export function edit(edits: Edit[], what: string, within = 0): void {
  try {
    const { text: next, spelled } = writeEdits(text.value, stating(settled.value, edits));
    commit(next, what, within);
    if (spelled.length) say(`${spelled.map((path) => path.join(" › ")).join(", ")}: an alias (*name) stood there; it is written out now, because it no longer has the value of its anchor.`);
  } catch (error) {
    cancelGesture();
    say(`${what}: the text of the design cannot be changed so (${(error as Error).message}). Nothing was changed; change it under "As text".`, true);
  }
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
  else if (canUndo.value) goTo(position.value - 1);
}

export function redo(): void {
  if (canRedo.value) goTo(position.value + 1);
}

/** One of the steps, again.  Versions that were kept meanwhile come along: to go back to where another begins takes none away. */
export function goTo(step: number): void {
  cancelGesture();
  batch(() => {
    const before = versions.value, [from, to] = [position.value, step].sort((a, b) => a - b), passed = steps.value.slice(from + 1, to + 1);
    position.value = step;
    if (passed.some(({ opens }) => opens) || !whole.value) return;
    const missing = before.filter(({ name }) => !versions.value.some((each) => each.name === name) && !passed.some(({ drops }) => drops === name));
    if (missing.length) amend([...versions.value, ...missing]);
  });
  autosave();
}

/** Other versions in the present step. */
function amend(all: Version[]): void {
  const source = writeEdits(text.value, [{ path: ["review", "versions"], value: all }]).text;
  steps.value = steps.value.map((step, k) => (k === position.value ? { ...step, text: source } : step));
}

export function open(source: string, what: string): void {
  if (source === text.value) return; // it is open, and its numbers are on the page
  batch(() => {
    selected.value = null;
    opened.value += 1;
    if (position.value < 0) {
      steps.value = [{ text: source, what }];
      position.value = 0;
    } else commit(source, what, 0, true);
  });
  autosave();
}

// --- keeping it ----------------------------------------------------------------------------------------------

/** What the browser keeps under a name; ``otherwise`` where that is nothing, or of another kind. */
export function recall<T>(key: string, otherwise: T, storage: () => Storage = () => localStorage): T {
  try {
    const kept = JSON.parse(storage().getItem(key) ?? "null");
    const kind = (value: unknown) => (Array.isArray(value) ? "list" : typeof value);
    return kept !== null && (otherwise === null || kind(kept) === kind(otherwise)) ? kept : otherwise;
  } catch {
    return otherwise;
  }
}

/** Keep it; false where the browser does not. */
export function remember(key: string, value: unknown, storage: () => Storage = () => localStorage): boolean {
  try {
    storage().setItem(key, JSON.stringify(value));
    return true;
  } catch {
    return false; // full, or not allowed: the page says that nothing is saved
  }
}

/** A list that all tabs of this browser share, each entry under a key of its own: two tabs that write at once write
 * different ones, and a change in another tab is seen here.  ``name``: the field that tells entries apart; ``texts``:
 * fields without which an entry is none of ours; ``order``: what they are sorted by. */
export function shareList<T extends object>(key: string, name: keyof T, texts: (keyof T)[], order: (entry: T) => number, changed: () => void = () => undefined) {
  const sound = (entries: T[]) => entries.filter((entry) => [name, ...texts].every((field) => typeof entry?.[field] === "string"));
  const read = () => sound(savedUnder(key).map((place) => recall<T>(place, {} as T))).sort((a, b) => order(a) - order(b));
  const list = signal<T[]>(read());
  let stored = true; // where it is not, the list lasts as long as the page
  window.addEventListener("storage", (event) => {
    if (event.key !== null && !event.key.startsWith(`${key}.`)) return;
    list.value = read();
    changed();
  });
  const change = (make: (old: T[]) => T[]) => {
    const old = stored ? read() : list.value, next = make(old);
    list.value = next;
    stored = next.every((entry) => old.includes(entry) || remember(`${key}.${entry[name]}`, entry));
    if (stored) for (const gone of old) if (!next.some((entry) => entry[name] === gone[name])) localStorage.removeItem(`${key}.${gone[name]}`);
  };
  return { list, change };
}

// Each tab has its own place for the design, and a new tab begins with what was saved last.
const session = () => sessionStorage;
let own = ""; // the key of this tab's place
const LEAVING = 300; // ms in which a page that is loaded anew has left its place

/** Take a place that no other tab has: one that was duplicated begins with the name of its first, and would write over it.
 * Returns where this page, or its first, was before. */
async function claim(): Promise<string> {
  const { locks } = navigator as { locks?: LockManager }; // none where the page came without encryption from another machine
  const held = async (place: string) => !locks || new Promise<boolean>((tell) => void locks.request(place, { signal: AbortSignal.timeout(LEAVING) }, () => {
    tell(true);
    return new Promise(() => null); // for as long as the page is there
  }).catch(() => tell(false)));
  const fresh = () => `${Date.now()}-${Math.random()}`, place = (tab: string) => `${AUTOSAVE}.${tab}`;
  const before = recall(TAB, fresh(), session);
  let tab = before;
  if (!(await held(place(tab)))) await held(place((tab = fresh())));
  remember(TAB, tab, session);
  own = place(tab);
  return place(before);
}

/** Forget what was saved longest ago, but for tabs that are open. */
async function forgetOld(): Promise<void> {
  const { locks } = navigator as { locks?: LockManager }, open = new Set((await locks?.query().catch(() => null))?.held?.map(({ name }) => name));
  for (const key of savedTabs().filter((each) => !open.has(each)).slice(8)) localStorage.removeItem(key);
}

interface Kept {
  steps: Step[];
  position: number;
  at: number;
}

function autosave(): void {
  const done = steps.value.slice(0, position.value + 1), now = done[position.value];
  if (!now) return;
  const keep = (some: Step[], undone: Step[] = [], storage?: () => Storage) => remember(own, { steps: [...some, ...undone], position: some.length - 1, at: Date.now() } satisfies Kept, storage);
  const some = fitting(done, MOST_SAVED);
  let room = MOST_SAVED - some.reduce((sum, { text: one }) => sum + one.length, 0);
  const undone = steps.value.slice(position.value + 1).filter(({ text: one }) => (room -= one.length) > 0);
  savedSteps.value = keep(some, undone) || keep(done.length > 1 ? [done[0], now] : [now]);
  if (!savedSteps.value) keep([now], [], session); // it outlives a reload, not the tab
  else if (recall(own, null, session)) sessionStorage.removeItem(own);
}

/** Where designs of tabs are saved, newest first. */
const savedTabs = () => savedUnder(AUTOSAVE).map((key) => [recall(key, { at: 0 }).at, key] as const).sort((a, b) => b[0] - a[0]).map(([, key]) => key);

/** Keys that begin with a name and a dot. */
function savedUnder(begin: string): string[] {
  try {
    return Object.keys(localStorage).filter((key) => key.startsWith(`${begin}.`));
  } catch {
    return [];
  }
}

/** What was last on this page, in this tab or another. */
export async function restore(): Promise<void> {
  const before = await claim();
  void forgetOld(); // it is not waited for
  const places = [recall(before, null, session), ...[before, ...savedTabs()].map((key) => recall(key, null))] as (Kept | null)[];
  for (const kept of places) {
    const sound = Array.isArray(kept?.steps) ? kept.steps.filter((step) => typeof step?.text === "string" && typeof step.what === "string") : [];
    if (!sound.length) continue;
    batch(() => {
      steps.value = sound;
      position.value = Math.min(Math.max(0, Math.trunc(Number(kept!.position)) || 0), sound.length - 1);
    });
    return autosave(); // says so at once where the browser keeps nothing
  }
}

export const now = () => `${new Date().toISOString().slice(0, 16)}Z`;
const LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ", MOST_VERSIONS = 50;

/** The text of the design without what a review left in it. */
const bare = (source: string) => (parse(source).data?.review === undefined ? source : writeEdits(source, [{ path: ["review"], value: undefined }]).text);

const contents = new Map<string, string>(); // by text
/** What a text says of a design, whatever is said about that. */
export function contentOf(source: string): string {
  if (contents.size > MOST_STEPS) contents.clear();
  const { review, ...rest } = parse(contents.has(source) ? "" : source).data ?? {};
  return contents.get(source) ?? contents.set(source, JSON.stringify(rest)).get(source)!;
}

/** Keep the design in its own document, by a name; null where that is taken, or there is no room. */
export function keepVersion(name = "", note = "", source = text.value): string | null {
  const used = new Set(versions.value.map((each) => each.name));
  const called = name || [...LETTERS].find((letter) => !used.has(letter)) || `V${used.size + 1}`;
  if (used.has(called) || used.size >= MOST_VERSIONS) return null;
  amend([...versions.value, { name: called, ...(note && { note }), date: now(), text: bare(source) }]);
  autosave();
  return called;
}

export function removeVersion(name: string): void {
  edit(without("versions", versions.value.filter((each) => each.name !== name)), `Remove version ${name}`);
  steps.value = steps.value.map((step, k) => (k === position.value ? { ...step, drops: name } : step));
  autosave();
}

/** Another state of this design is the design again; versions and comments stay. */
export function takeState(source: string, what: string): void {
  commit(writeEdits(source, [{ path: ["review"], value: whole.value.review }]).text, what);
}

/** What was run is the design again: a state of this one, or another design. */
export function takeRun(source: string, what: string): void {
  if (whole.value && parse(source).data?.name === whole.value.name) takeState(source, what);
  else open(source, what);
}

/** Another list of a review; without any, there is no review. */
function without(list: string, left: Json[]): Edit[] {
  const others = Object.keys(whole.value?.review ?? {}).some((each) => each !== list);
  return [left.length ? { path: ["review", list], value: left } : { path: others ? ["review", list] : ["review"], value: undefined }];
}

export const setComments = (all: Json[], what: string) => edit(without("comments", all), what);

// --- the first page ------------------------------------------------------------------------------------------

const START = "#start", address = signal(location.hash);
window.addEventListener("hashchange", () => (address.value = location.hash));
/** Whether the first page is shown: nothing is open, or the address says so; the browser's own buttons lead there and back. */
export const first = computed(() => steps.value.length === 0 || address.value === START);
/** From there to the design. */
export function leaveFirst(): void {
  if (!first.value || location.hash.startsWith("#design=")) return; // a link stays in the address
  const here = location.pathname + location.search;
  history.replaceState(null, "", here + START);
  history.pushState(null, "", here);
  address.value = "";
}

// --- the whole design in the link ----------------------------------------------------------------------------

export const linked = signal<string | null>(null); // the text that the address holds; one that is no design is ""

// An address that says another design than the page is taken away: a reload, or a bookmark, would bring that one back
effect(() => {
  if (linked.value === null || text.value === "" || linked.value === text.value) return;
  linked.value = null;
  history.replaceState(null, "", location.pathname + location.search);
});

export const LONGEST_LINK = 8000; // characters; longer ones are cut by mail programs and chats

export async function through(bytes: Uint8Array, stream: CompressionStream | DecompressionStream): Promise<Uint8Array> {
  const piped = new Blob([bytes as BlobPart]).stream().pipeThrough(stream as unknown as ReadableWritablePair);
  return new Uint8Array(await new Response(piped).arrayBuffer());
}

export const base64 = (bytes: Uint8Array): string => btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""));

export async function linkOf(source: string): Promise<string> {
  const packed = await through(new TextEncoder().encode(source), new CompressionStream("deflate-raw"));
  return `${location.origin}${location.pathname}#design=${base64(packed).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "")}`;
}

/** The design that a link holds, or null.  Throws where the link was cut. */
export async function textOfLink(hash: string): Promise<string | null> {
  const found = /^#design=([\w-]+)$/.exec(hash);
  if (!found) return null;
  const bytes = Uint8Array.from(atob(found[1].replace(/-/g, "+").replace(/_/g, "/")), (c) => c.charCodeAt(0));
  return new TextDecoder("utf-8", { fatal: true }).decode(await through(bytes, new DecompressionStream("deflate-raw")));
}
