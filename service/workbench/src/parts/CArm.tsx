// The first page's questions: which C-arm sees the beads, a published one or one's own, and within what the error stays.

import { computed, signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { key, send } from "../api";
import { type CArm, type Lengths, startLengths, type Wishes } from "../first";
import { readNumber, whyNoNumber } from "../words";

const OWN = "", START = "generic-mobile-c-arm";
const cArms = signal<CArm[]>([]), chosen = signal(START), limit = signal(1); // mm
const own = signal<Lengths>({ source_detector_mm: 1000, source_isocentre_mm: 600, pixel_mm: 0.3, image_size_px: [1024, 1024] });
const stated = signal<ReadonlySet<string>>(new Set());
const state = (field: string) => (stated.value = new Set([...stated.value, field]));
const arm = computed(() => cArms.value.find(({ name }) => name === chosen.value));

/** What was answered, once the service has said which C-arms are published. */
export async function wishes(): Promise<Wishes> {
  if (!cArms.value.length) await load();
  return { arm: chosen.value === OWN ? own.value : arm.value ?? own.value, limit_mm: limit.value, stated: stated.value };
}

async function load(): Promise<void> {
  const response = await send("GET", "/v1/presets").catch(() => null);
  if (response?.ok) cArms.value = (await response.json()).presets;
}

/** Why what is typed in a field here cannot be taken, by the field's words. */
const wrong = signal<ReadonlyMap<string, string>>(new Map());
/** What is to be mended before anything begins. */
export const unread = computed(() => [...wrong.value].map(([words, why]) => `${words}: ${why}`)[0] ?? null);

function Length({ words, unit, value, take }: { words: string; unit: string; value: string; take: (value: number) => void }) {
  const why = wrong.value.get(words), tell = (told: string | null) => {
    const all = new Map(wrong.peek());
    if (told) all.set(words, told);
    else all.delete(words);
    wrong.value = all;
  };
  useEffect(() => () => tell(null), []);
  return (
    <>
      <label>{`${words}, ${unit} `}
        <input type="text" inputMode="decimal" size={6} defaultValue={value} aria-invalid={why !== undefined} onInput={({ currentTarget: { value: typed } }) => {
          const read = readNumber(typed, unit), good = read !== null && read > 0;
          tell(good ? null : read === null ? whyNoNumber(typed, unit) : "it must be above 0");
          if (good) take(read);
        }} />
      </label>
      {why && <span class="wrong" role="alert">{why}</span>}
    </>
  );
}

export function CArmChoice() {
  useEffect(() => {
    if (!cArms.value.length) void load();
  }, [key.value]);
  const lengths = own.value, set = (change: Partial<Lengths>, field: string) => {
    own.value = { ...lengths, ...change };
    state(field);
  };
  const length = (words: string, field: "source_detector_mm" | "source_isocentre_mm" | "pixel_mm") => <Length key={field} words={words} unit="mm" value={String(lengths[field])} take={(value) => set({ [field]: value }, field)} />;
  const side = (words: string, k: 0 | 1) => <Length words={words} unit="px" value={String(lengths.image_size_px![k])} take={(value) => set({ image_size_px: lengths.image_size_px!.map((old, j) => (j === k ? Math.round(value) : old)) as [number, number] }, "image_size_px")} />;
  return (
    <>
      <label>C-arm{" "}
        <select value={chosen.value} onChange={(event) => {
          chosen.value = event.currentTarget.value;
          state("arm");
        }}>
          {(cArms.value.length ? cArms.value : [{ name: START, title: "Generic mobile C-arm" }]).map(({ name, title }) => <option key={name} value={name}>{title}</option>)}
          <option value={OWN}>My C-arm</option>
        </select>
      </label>
      {chosen.value === OWN && <>{length("source to detector", "source_detector_mm")}{length("source to isocentre", "source_isocentre_mm")}{length("pixel", "pixel_mm")}{side("image, width", 0)}{side("height", 1)}</>}
      <Length words="95 % of all errors within" unit="mm" value={String(limit.value)} take={(value) => {
        limit.value = value;
        state("limit_mm");
      }} />
    </>
  );
}

const WORDS = { source_isocentre_mm: "source to isocentre", pixel_mm: "pixel" } as const;

/** What is known of the C-arm, and from where. */
export function CArmNote() {
  const known = arm.value;
  if (!known) return null;
  const said = [`source to detector ${known.source_detector_mm} mm`, known.image_size_px && `${known.image_size_px.join(" × ")} pixels`, known.pixel_mm && `of ${known.pixel_mm} mm`].filter(Boolean).join(", ");
  const start = startLengths(known), missing = (["source_isocentre_mm", "pixel_mm"] as const).filter((field) => known[field] == null).map((field) => `${WORDS[field]} ${start[field]} mm`);
  return <p class="note">{`${said}; from ${known.source}${missing.length ? `. Not published, and assumed: ${missing.join(", ")}` : ""}.`}</p>;
}
