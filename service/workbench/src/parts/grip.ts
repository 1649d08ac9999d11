// A handle on a scale: taken by pointer or finger and moved along it, pressed, or moved with keys.

interface Grip {
  track(): DOMRect; // along which it goes
  begin(): boolean; // false: nothing can be moved now
  to(part: number, wide: number): void; // of the track, which is so many pixels wide
  end(): void;
  drop(): void; // as it was
  press?(): void;
}
const STILL = 3; // pixels, within which a press moves nothing
let from: number | null = null, holds = false; // where a pointer went down; whether it has moved since

type At<E> = E & { currentTarget: HTMLElement };
/** What an element listens to in order to be such a handle. */
export const grip = ({ track, begin, to, end, drop, press }: Grip) => ({
  onPointerDown(event: At<PointerEvent>) {
    if (event.button !== 0) return;
    event.currentTarget.setPointerCapture(event.pointerId);
    [from, holds] = [event.clientX, false];
  },
  onPointerMove(event: At<PointerEvent>) {
    if (from === null || !event.currentTarget.hasPointerCapture(event.pointerId)) return;
    if (!holds && (Math.abs(event.clientX - from) < STILL || !(holds = begin()))) return;
    const { left, width } = track();
    to(Math.min(1, Math.max(event.clientX - left, 0) / width), width);
  },
  onPointerUp() {
    if (from !== null) (holds ? end : press)?.();
    from = null;
  },
  onPointerCancel() {
    from = null;
    drop();
  },
});

/** How much a key moves what is held, in its steps. */
export const NUDGE = (event: KeyboardEvent) => (event.shiftKey ? 10 : event.altKey ? 0.1 : 1);
/** Up or down a scale, in such steps; null for any other key. */
export function stepsOf(event: KeyboardEvent, page = 10): number | null {
  const way = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: page, PageDown: -page }[event.key];
  return way === undefined ? null : way * NUDGE(event);
}
