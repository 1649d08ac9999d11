// A computed result as a report, in each of its forms; and what is saved as a file.

import { addressOf, key, readRefusal, send, unreachable } from "../api";
import { design, type Json, say } from "../state";

/** The name of a design as that of a file; by the same rule as the service names reports (http/jobs.py). */
export const fileName = (named: Json = design.value?.name) => String(named ?? "").toLowerCase().normalize("NFKD").replace(/\p{M}/gu, "").replace(/[^a-z0-9]+/g, "-").replace(/^-|-$/g, "").slice(0, 60).replace(/-$/, "") || "design";

export function Reports({ path, of }: { path: string; of?: string }) {
  return <>{["html", "pdf", "xlsx", "json"].map((form) => <ReportLink key={form} path={path} form={form} words={form.toUpperCase()} of={of} />).concat(<ReportLink key="summary" path={path} form="pdf" words="one page" of={of} summary />).flatMap((link, k) => (k ? [" · ", link] : [link]))}</>;
}

/** Reports are links; with a key they are fetched with it and saved. */
export function ReportLink({ path, form, words, of, button = false, summary = false }: { path: string; form: string; words: string; of?: string; button?: boolean; summary?: boolean }) {
  const address = `${path}?format=${form}${summary ? "&summary=true" : ""}`, name = `${fileName(of)}${summary ? ".summary" : ""}.${form}`;
  const fetched = async (event: Event) => {
    if (!key.value) return;
    event.preventDefault();
    await saveAnswer("GET", address, undefined, {}, name, "The report");
  };
  return <a class={button ? "button" : undefined} href={addressOf(address)} target={form === "html" ? "_blank" : undefined} rel="noopener" download={form === "html" ? undefined : name} onClick={fetched}>{words}</a>;
}

/** Save what the service answers with; what: the subject of the sentence where it does not. */
export async function saveAnswer(method: string, path: string, body: unknown, headers: Record<string, string>, name: string, what: string): Promise<void> {
  say(`${what} is being written.`);
  const response = await send(method, path, body, headers).catch(() => null);
  if (response?.ok) {
    save(await response.blob(), name);
    return say(`${what} is saved as ${name}.`);
  }
  const { title, errors } = response ? await readRefusal(response) : unreachable();
  say(`${what} does not come: ${title}. ${errors[0].detail}`, true);
}

/** What a supplier makes the design by. */
export const handOver = (form: "pdf" | "html" | "csv") => saveAnswer("POST", "/v1/sheets", { design: design.value }, { Accept: { pdf: "application/pdf", html: "text/html", csv: "text/csv" }[form] }, `${fileName()}.supplier.${form}`, "The sheet");

export function save(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  window.setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
