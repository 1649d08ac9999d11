// Jobs of this page: they go on when it is closed, and are found again.

import { signal } from "@preact/signals";
import { readRefusal, type Refusal, send } from "./api";
import { design, type Json, recall, remember, text } from "./state";

export interface Run {
  id: string;
  kind: string;
  title: string;
  text: string; // the design that it is of
  state: string;
  fraction: number;
  note: string;
  eta: number | null;
  result: string | null; // SHA-256
  problem: Refusal | null;
  begun: number;
}

const RUNS = "tailstack.workbench.runs", MOST = 30;
export const runs = signal<Run[]>(recall(RUNS, []));
export const results = signal<Record<string, Json>>({});
export const startProblem = signal<Refusal | null>(null);
const followed = new Set<string>();

function keep(next: Run[]): void {
  runs.value = next.slice(0, MOST);
  remember(RUNS, runs.value); // where that fails, the list lasts as long as the page
}

const change = (id: string, values: Partial<Run>) => keep(runs.value.map((run) => (run.id === id ? { ...run, ...values } : run)));
export const forget = (id: string) => keep(runs.value.filter((run) => run.id !== id));
export const unfinished = (run: Run) => run.state === "queued" || run.state === "running";

export async function start(kind: string, path: string, title: string, options: Json): Promise<void> {
  startProblem.value = null;
  try {
    const headers = { "Idempotency-Key": crypto.randomUUID() };
    const response = await send("POST", path, { design: design.value, ...options }, headers);
    if (!response.ok) {
      startProblem.value = await readRefusal(response);
      return;
    }
    const job = await response.json();
    keep([{ id: job.id, kind, title, text: text.value, state: job.state, fraction: 0, note: "", eta: null, result: null, problem: null, begun: Date.now() }, ...runs.value]);
    void follow(job.id);
  } catch {
    startProblem.value = { status: 0, title: "The service does not answer", type: "", errors: [] };
  }
}

export async function cancel(id: string): Promise<void> {
  await send("POST", `/v1/jobs/${id}/cancel`).catch(() => null);
  await look(id);
}

async function look(id: string): Promise<boolean> {
  const response = await send("GET", `/v1/jobs/${id}`);
  if (response.status === 404) {
    change(id, { state: "gone", note: "the service no longer knows this job" });
    return false;
  }
  if (!response.ok) return true;
  const job = await response.json();
  const problem = job.problem ? { status: job.problem.status, title: job.problem.title, type: job.problem.type, errors: (job.problem.errors ?? []).map((e: Json) => ({ pointer: e.pointer, detail: e.detail, hint: e.hint, rule: e.code })) } : null;
  change(id, { state: job.state, fraction: job.progress.fraction, note: job.progress.note, eta: job.progress.eta_seconds, result: job.result_sha256, problem });
  if (job.result_sha256) await loadResult(job.result_sha256);
  return job.state === "queued" || job.state === "running";
}

export async function loadResult(sha256: string): Promise<void> {
  if (results.value[sha256]) return;
  const response = await send("GET", `/v1/results/${sha256}`);
  if (response.ok) results.value = { ...results.value, [sha256]: await response.json() };
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
