// Repeats of calls: when, how often, and how long to wait before.

import { ConnectionFailed, Problem } from "./problems.js";

/**
 * Limits on the repeats of a call.
 *
 * A call is repeated after 429 and 503 (and a proxy's 502 and 504), not before `Retry-After` says; and after a
 * connection that failed, unless the call deletes something and may have been carried out.
 */
export interface Retry {
  /** Repeats at most; 0 for none. */
  times: number;
  /** No repeat starts later than this after the call began. */
  totalS: number;
  /** The wait before the first repeat if the answer names none, doubled for each further one. Half of it is random. */
  firstS: number;
  /** The longest such wait. */
  longestS: number;
}

export const RETRY: Readonly<Retry> = { times: 4, totalS: 60, firstS: 0.5, longestS: 8 };

const LATER = [429, 502, 503, 504]; // statuses of answers that a repeat may change

/** Run `once` until it succeeds or a repeat would not help. `isRepeatable`: it may be carried out twice. */
export async function repeated<T>(
  once: () => Promise<T>,
  retry: Retry,
  isRepeatable: boolean,
  signal: AbortSignal | undefined,
): Promise<T> {
  const start = performance.now();
  for (let repeats = 0; ; repeats++) {
    try {
      return await once();
    } catch (error) {
      const waitS = waitOf(error, retry, repeats);
      const isLate = (performance.now() - start) / 1000 + waitS > retry.totalS;
      if (!mayHelp(error, isRepeatable) || repeats >= retry.times || isLate) throw error;
      await wait(waitS, signal);
    }
  }
}

function mayHelp(error: unknown, isRepeatable: boolean): boolean {
  if (error instanceof ConnectionFailed) return isRepeatable;
  return error instanceof Problem && LATER.includes(error.status);
}

function waitOf(error: unknown, { firstS, longestS }: Retry, repeats: number): number {
  const waitS = Math.min(firstS * 2 ** repeats, longestS) * (0.5 + 0.5 * Math.random());
  const retryAfterS = error instanceof Problem ? error.retryAfterS : undefined;
  return retryAfterS === undefined ? waitS : retryAfterS + Math.min(waitS, 1 + retryAfterS) / 2;
}

/** Wait; throws the signal's reason if it is aborted. */
function wait(seconds: number, signal: AbortSignal | undefined): Promise<void> {
  return new Promise((done, failed) => {
    signal?.throwIfAborted();
    const abort = () => {
      clearTimeout(timer);
      failed(signal?.reason);
    };
    const timer = setTimeout(() => {
      signal?.removeEventListener("abort", abort);
      done();
    }, 1000 * seconds);
    signal?.addEventListener("abort", abort, { once: true });
  });
}
