// The service behind the page: requests, refusals, and the scores and layouts that follow the design.

import { batch, computed, effect, signal, untracked } from "@preact/signals";
import type { components } from "../../../openapi/typescript/tailstack";
import { notFinite } from "./document";
import { design, errors, gesture, type Json, opened, type Path, valueAt, withEdits } from "./state";

export type Score = components["schemas"]["Score"];
export type TargetScore = components["schemas"]["TargetScore"];
export type Layout = components["schemas"]["Layout"];
export interface Refusal {
  status: number;
  title: string;
  type: string;
  errors: { pointer: string; detail: string; hint: string; rule: string; file?: string }[];
}

export const key = signal<string | null>(null); // in memory only: it is gone with the page
export const keyWanted = signal(false);
export const reachable = signal(true);

/** Where a path of the service is for this page: whether or not what stands before the service passes on the part of the
 * address that it gave it, and so whether or not the service's own links begin with that. */
export const addressOf = (path: string): string => new URL(/\/v1\/(?!.*\/v1\/).*$/.exec(path)?.[0].slice(1) ?? path.replace(/^\//, ""), new URL(".", location.href)).href;

/** The STL file that was dropped, as the service takes it: gzip in base64; empty where that is too long. */
export const dropped = signal<{ file: string; content: string } | null>(null);

/** What is sent has the surface that its design names by file: the service reads none. */
function withSurface(body: Json): Json {
  const path = ["design", "optimise", "region", "surface"], named = valueAt(body, path), held = dropped.value;
  return held?.content && named && !named.content && named.file?.split("/").pop() === held.file ? withEdits(body, [{ path: [...path, "content"], value: held.content }]) : body;
}

/** Ask once nothing has changed for so many milliseconds.  What it returns gives that up, as an effect does at its end. */
export function askWhenQuiet(quiet: number, ask: (left: AbortSignal) => Promise<void>): () => void {
  const left = new AbortController(), timer = window.setTimeout(() => void ask(left.signal), quiet);
  return () => {
    window.clearTimeout(timer);
    left.abort();
  };
}

/** Ask, and know a refusal from a service that is not there.  What JSON cannot say is refused here, as the service would. */
export async function send(method: string, path: string, body?: unknown, headers: Record<string, string> = {}, signal?: AbortSignal): Promise<Response> {
  const given: Record<string, string> = { ...headers };
  if (body !== undefined && !given["Content-Type"]) given["Content-Type"] = "application/json";
  if (key.value) given.Authorization = `Bearer ${key.value}`;
  const whole = body === undefined || typeof body === "string" || body instanceof Blob, strange = whole ? [] : notFinite(body);
  if (strange.length) return Response.json({ title: "The design document is not valid", errors: strange.slice(0, 25).map(({ pointer, value }) => ({
    pointer, code: "not-finite", detail: `must be a finite number; got ${Number.isNaN(value) ? ".nan" : value < 0 ? "-.inf" : ".inf"}`, hint: "write a number, or take the field out",
  })) }, { status: 422 });
  const content = whole ? body : JSON.stringify(withSurface(body as Json));
  try {
    const response = await fetch(addressOf(path), { method, body: content, headers: given, cache: "no-store", signal }), { status, headers: told } = response;
    const answered = await response.arrayBuffer(); // an answer that breaks off in the middle is none
    reachable.value = true;
    if (status === 401) keyWanted.value = true;
    return new Response(status === 204 ? null : answered, { status, headers: told });
  } catch (error) {
    if (!signal?.aborted) reachable.value = false;
    throw error;
  }
}

// A service that is away is looked for until it is back: what needs it then goes on by itself
effect(() => {
  if (reachable.value) return;
  const timer = window.setInterval(() => void send("GET", "/health/live").catch(() => null), 2000);
  return () => window.clearInterval(timer);
});

export async function readRefusal(response: Response): Promise<Refusal> {
  return refusalOf(await response.json().catch(() => ({})), response.status);
}

/** An answer of the kind "problem", with pointers that lead into the design. */
export function refusalOf(problem: Json, status: number): Refusal {
  const errors = (problem.errors ?? []).map((entry: Json) => ({
    pointer: String(entry.pointer ?? "").replace(/^\/design(?=\/|$)/, ""),
    detail: String(entry.detail ?? ""),
    hint: String(CURES[entry.code] ?? entry.hint ?? ""),
    rule: String(entry.code ?? ""),
    file: String(entry.file ?? ""),
  }));
  const title = problem.title ?? `The service answered with ${status}`;
  if (status === 401) errors.splice(0, errors.length, { pointer: "", detail: key.value === null ? "This service asks for an API key." : "The service does not know this key.", hint: "give a key in the field above; whoever runs the service has them", rule: "key" });
  if (!errors.length) errors.push({ pointer: "", detail: problem.detail ?? title, hint: "", rule: "" });
  return { status, title, type: problem.type ?? "", errors };
}

/** What to do on this page, where the service's words are for somebody who calls it from a script. */
const CURES: Record<string, string> = { "file-refused": "drop that file on this page" };

/** A text that is no design, or cannot be read at all. */
const unreadable = (marks: { message: string }[]): Refusal => ({
  status: 422, title: "The text is no design", type: "",
  errors: marks.map(({ message }) => ({ pointer: "", detail: message, hint: 'undo, or mend it under "As text"', rule: "unreadable" })),
});

export const pathOf = (pointer: string): Path =>
  pointer.split("/").slice(1).map((part) => {
    const name = part.replace(/~1/g, "/").replace(/~0/g, "~");
    return /^\d+$/.test(name) ? Number(name) : name;
  });

/** A place in the design in words: "fiducials › F3 › position_mm". */
export function placeInWords(data: Json, pointer: string): string {
  const path = pathOf(pointer);
  return path.map((part, k) => {
    const item = typeof part === "number" ? valueAt(data, path.slice(0, k + 1)) : null;
    return item?.label ?? item?.name ?? String(part);
  }).join(" › ");
}

// --- one score in flight, the latest design wins -------------------------------------------------------------

const SLOW = 1000; // ms

interface Answer {
  design: Json; // the object that was sent: the answer is current while it is the page's design
  score: Score;
}

export const layout = signal<Layout | null>(null); // of the last design that had one
export const drawn = signal<Json>(null); // the design of that layout
export const answer = signal<Answer | null>(null); // the last good one
export const refusal = signal<{ design: Json; problem: Refusal } | null>(null);
export const busy = signal(false);
/** Names of all targets, of the last score that told all. */
export const targetNames = signal<readonly string[]>([]);
/** Of which targets more is shown than of all: the one whose budget is there, and by their names tables of every target. */
export const budgetOf = signal<string | null>(null);
export const openTables = signal<ReadonlySet<string>>(new Set());
export const turnTable = (name: string, open: boolean) => void (openTables.value = new Set(open ? [...openTables.value, name] : [...openTables.value].filter((each) => each !== name)));
export const current = computed(() => answer.value !== null && answer.value.design === design.value);
export const refused = computed(() => (errors.value.length ? unreadable(errors.value) : refusal.value?.design === design.value ? refusal.value!.problem : null));
/** Whether the numbers on the page have been those of another design for longer than an eye follows. */
export const late = signal(false);
const FOLLOWED = 150; // ms: while something is dragged, numbers that come sooner after one another are those of the drag
effect(() => {
  answer.value; // each answer begins anew
  if (current.value) {
    late.value = false;
    return;
  }
  const timer = window.setTimeout(() => (late.value = true), FOLLOWED);
  return () => window.clearTimeout(timer);
});
/** What is wrong with the design, or with the service. */
export const trouble = computed(() => refused.value ?? (reachable.value ? null : unreachable()));

let wanted: Json = null;
let retry = 0;
let tookBefore = 0; // ms that the answer before the last one took
let slow = false; // hundreds of targets: a number for each move would come when it is let go, and delay the one that counts

effect(() => {
  if (!opened.value) return;
  answer.value = layout.value = null;
  targetNames.value = [];
});
effect(() => {
  wanted = gesture.value.length && slow ? null : design.value;
  key.value; // with another key it is asked again, with a file that it named, and where another text of it is opened
  opened.value;
  dropped.value;
  if (wanted) untracked(() => void follow());
});

effect(() => {
  if (!reachable.value || untracked(() => refused.value?.status) !== 0) return;
  wanted = untracked(() => design.value); // the service is back
  void untracked(follow);
});

async function follow(): Promise<void> {
  if (busy.value) return;
  busy.value = true;
  try {
    while (wanted) {
      const sent = wanted;
      wanted = null;
      await scoreOnce(sent);
      // What is dragged moves in the pictures at once; where everything is follows when it is let go, or while a beam is
      // turned, for then everything moves in the image.  A design that was refused is drawn, too: a picture shows best
      // what is wrong with it
      if (!wanted && (!gesture.value.length || gesture.value.some(({ path }) => path[2] === "beam_direction"))) await drawOnce(sent);
    }
  } finally {
    busy.value = false;
  }
}

async function scoreOnce(sent: Json): Promise<void> {
  const moving = gesture.value.length > 0, losses = !slow && !moving; // they take half of a score's time again
  const told = moving && targetNames.value.length && !openTables.value.size ? { targets: targetNames.value.filter((name) => name === budgetOf.value) } : {};
  const begin = performance.now();
  try {
    const response = await send("POST", "/v1/scores", { design: sent, losses, fifty_shots: true, ...told });
    if (response.ok) {
      const score = (await response.json()) as Score;
      if (!understood(score)) {
        refusal.value = { design: sent, problem: otherVersion() };
        return;
      }
      batch(() => {
        if (!("targets" in told)) targetNames.value = score.targets.map(({ name }) => name);
        answer.value = { design: sent, score };
      });
      refusal.value = null;
      const took = performance.now() - begin;
      slow = Math.min(took, tookBefore) > SLOW; // one slow answer says little
      tookBefore = took;
      retry = 0;
      return;
    }
    const problem = await readRefusal(response);
    if (response.status === 503 || response.status === 429) later(sent, Number(response.headers.get("Retry-After") ?? 1));
    refusal.value = { design: sent, problem };
  } catch {
    refusal.value = { design: sent, problem: unreachable() };
    later(sent, Math.min(10, 0.5 * 2 ** retry++));
  }
}

/** Where things are: asked for when no newer score is wanted, so that nothing is beside a score in flight. */
async function drawOnce(sent: Json): Promise<void> {
  if ((drawn.value === sent && layout.value) || !reachable.value) return;
  try {
    const response = await send("POST", "/v1/layouts", { design: sent, scene: true });
    if (!response.ok) return;
    layout.value = (await response.json()) as Layout;
    drawn.value = sent;
  } catch {
    // the score that comes next says that the service is away
  }
}

let again = 0; // the timer: one, or a design that failed twice would be asked for by two that each go on

function later(sent: Json, seconds: number): void {
  window.clearTimeout(again);
  again = window.setTimeout(() => {
    if (design.value === sent && refused.value) {
      wanted = sent;
      void follow();
    }
  }, 1000 * seconds);
}

const SCORE: Score["schema"] = "tailstack/score/1";
const understood = (score: Score) => score.schema === SCORE && Array.isArray(score.targets) && Array.isArray(score.verdict?.checks) && Array.isArray(score.verdict.findings);
const otherVersion = (): Refusal => ({
  status: 0, title: "The page is of another version than the service", type: "",
  errors: [{ pointer: "", detail: "It does not understand the answer.", hint: "reload the page: the design is kept in this browser", rule: "version" }],
});

export const unreachable = (): Refusal => ({
  status: 0,
  title: "The service does not answer",
  type: "",
  errors: [{ pointer: "", detail: "The design is kept in this browser; the page asks again by itself.", hint: "start it again where it was started", rule: "unreachable" }],
});
