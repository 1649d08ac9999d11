// The main job with the types alone, no library: score, check as a job, poll, fetch the result, read a refusal.
// Node 20, Deno, Bun and browsers have `fetch`. The tests type-check this file with --strict.

import type { components, operations } from "./tailstack";

type Design = components["schemas"]["Design"];
type Score = components["schemas"]["Score"];
type Job = components["schemas"]["Job"];
type Verification = components["schemas"]["Verification"];
type Problem = components["schemas"]["Problem"];
type VerificationRequest = components["schemas"]["VerificationRequest"];
type Accepted = operations["create_verification"]["responses"][202]["content"]["application/json"];

export class Refused extends Error {
  constructor(readonly problem: Problem) {
    super(problem.errors.map((entry) => `${entry.pointer}: ${entry.detail} ${entry.hint}`).join("\n"));
  }
}

export class Tailstack {
  constructor(
    private readonly base: string,
    private readonly key?: string,
  ) {}

  private async call(method: "GET" | "POST", path: string, body?: unknown): Promise<Response> {
    const headers: Record<string, string> = { "Content-Type": "application/json" };
    if (this.key !== undefined) headers["Authorization"] = `Bearer ${this.key}`;
    const init: RequestInit = { method, headers };
    if (body !== undefined) init.body = JSON.stringify(body);
    const response = await fetch(new URL(path, this.base), init);
    if (!response.ok) throw new Refused((await response.json()) as Problem);
    return response;
  }

  async score(design: Design): Promise<Score> {
    const request: components["schemas"]["ScoreRequest"] = { design, second_order: false };
    return (await this.call("POST", "/v1/scores", request)).json() as Promise<Score>;
  }

  /** The verification of a design; `progress` hears of the fraction that is done, from 0 to 1. */
  async verify(request: VerificationRequest, progress: (fraction: number) => void): Promise<Verification> {
    const accepted = (await (await this.call("POST", "/v1/verifications", request)).json()) as Accepted;
    let job: Job = accepted;
    while (job.state === "queued" || job.state === "running") {
      const response = await this.call("GET", job.links.self);
      job = (await response.json()) as Job;
      progress(job.progress.fraction);
      const seconds = Number(response.headers.get("Retry-After") ?? "1");
      await new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
    }
    if (job.problem !== null) throw new Refused(job.problem);
    if (job.links.result === null) throw new Error(`the job was ${job.state}`);
    return (await this.call("GET", job.links.result)).json() as Promise<Verification>;
  }
}

/** P95 of each target, first order beside Monte Carlo, mm. */
export async function compared(service: Tailstack, design: Design): Promise<[string, number, number][]> {
  const score = await service.score(design);
  const check = await service.verify({ design, precision: 0.01, seed: 7, method: "plain" }, console.log);
  return check.targets.map((target, place) => [target.name, score.targets[place]?.p95_mm ?? NaN, target.p95_mm]);
}
