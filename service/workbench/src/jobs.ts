// Jobs of this page and of the service: they go on when the page is closed, and are found again.

import { signal } from "@preact/signals";
import type { components } from "../../../openapi/typescript/tailstack";
import { readRefusal, type Refusal, refusalOf, send, unreachable } from "./api";
import { type Json, shareList, text, whole, writeYaml } from "./state";

type Job = components["schemas"]["Job"];

export interface Run {
  id: string;
  kind: string;
  title: string;
  text: string; // the design that it is of; empty where that is not known
  state: string;
  fraction: number;
  note: string;
  eta: number | null;
  result: string | null; // SHA-256
  report: string | null; // path of the result as a report
  problem: Refusal | null;
  begun: number;
}

const MOST = 30;
const shelf = shareList<Run>("tailstack.workbench.runs", "id", ["kind", "title", "text", "state"], ({ begun }) => -begun, () => resume());
export const runs = shelf.list;
export const results = signal<Record<string, Json>>({});
export const startProblem = signal<Refusal | null>(null);
export const recent = signal<Job[]>([]); // of the service, newest first
const followed = new Set<string>();

const change = (id: string, values: Partial<Run>) => shelf.change((kept) => kept.map((run) => (run.id === id ? { ...run, ...values } : run)));
export const forget = (id: string) => shelf.change((kept) => kept.filter((run) => run.id !== id));
export const unfinished = (run: { state: string }) => run.state === "queued" || run.state === "running";

/** An optimisation that found that there is no such design: which is an answer. */
export const outOfReach = (run: { state: string; problem: { type: string } | null }) => run.state === "failed" && /\/infeasible$/.test(run.problem?.type ?? "");
const STATES: Record<string, string> = { succeeded: "computed", gone: "no longer known to the service" }; // what came of it is said elsewhere
export const stateWords = (run: { state: string; problem: { type: string } | null }) => (outOfReach(run) ? "no design keeps the limit" : STATES[run.state] ?? run.state);

export async function start(title: string, path: string, options: Json): Promise<void> {
  startProblem.value = null;
  try {
    const headers = { "Idempotency-Key": crypto.randomUUID() };
    const response = await send("POST", path, { ...("second" in options ? {} : { design: whole.value }), ...options }, headers);
    if (!response.ok) {
      startProblem.value = await readRefusal(response);
      return;
    }
    adopt((await response.json()) as Job, title, text.value);
  } catch {
    startProblem.value = unreachable();
  }
}

const runOf = (job: Job) => ({
  state: job.state, fraction: job.progress.fraction, note: job.progress.note, eta: job.progress.eta_seconds,
  result: job.result_sha256, report: job.links.report, problem: job.problem && refusalOf(job.problem, job.problem.status),
});

/** Show a job among those of this page, and follow it to its end. */
export function adopt(job: Job, title: string, source: string): void {
  const run = { id: job.id, kind: job.kind, title, text: source, begun: Date.parse(job.created_at), ...runOf(job) };
  shelf.change((kept) => [run, ...kept.filter((other) => other.id !== job.id)].slice(0, MOST));
  void follow(job.id);
}

/** The newest jobs that the service knows, whoever started them. */
export async function loadRecent(): Promise<void> {
  const response = await send("GET", "/v1/jobs?limit=20").catch(() => null);
  if (response?.ok) recent.value = (await response.json()).jobs;
}

export async function cancel(id: string): Promise<void> {
  await send("POST", `/v1/jobs/${id}/cancel`).catch(() => null);
  await look(id);
}

/** A run of which the service has lost something, with its database or because it is old. */
const lost = (what: string): Partial<Run> => ({
  state: "gone", result: null, report: null,
  problem: { status: 404, title: `The service no longer has ${what}`, type: "", errors: [{ pointer: "", detail: "It was taken away there, or its database is another one.", hint: "run it again", rule: "gone" }] },
});

async function look(id: string): Promise<boolean> {
  const response = await send("GET", `/v1/jobs/${id}`);
  if (response.status === 404) {
    change(id, lost("this job"));
    return false;
  }
  if (!response.ok) return true;
  const job = (await response.json()) as Job;
  change(id, runOf(job));
  if (job.result_sha256) await loadResult(job.result_sha256);
  if (unfinished(job)) return true;
  void loadRecent();
  return false;
}

export async function loadResult(sha256: string): Promise<void> {
  if (results.value[sha256]) return;
  const response = await send("GET", `/v1/results/${sha256}`).catch(() => null);
  if (response?.status === 404) shelf.change((kept) => kept.map((run) => (run.result === sha256 ? { ...run, ...lost("its result") } : run)));
  if (!response?.ok) return;
  const record = await response.json(), held = record.design_before ?? record.design;
  results.value = { ...results.value, [sha256]: record };
  if (held) shelf.change((kept) => kept.map((run) => (run.result === sha256 && !run.text ? { ...run, text: writeYaml(held) } : run)));
}

/** Follow a job to its end, through restarts of the service. */
export async function follow(id: string): Promise<void> {
  if (followed.has(id)) return;
  followed.add(id);
  let wait = 250;
  try {
    while (runs.value.some((run) => run.id === id)) {
      try {
        if (!(await look(id))) return;
        wait = Math.min(1500, wait * 1.3);
      } catch {
        wait = 1500; // it is being restarted, perhaps
      }
      await new Promise((done) => window.setTimeout(done, wait));
    }
  } finally {
    followed.delete(id);
  }
}

export function resume(): void {
  for (const run of runs.value) if (unfinished(run)) void follow(run.id);
}
