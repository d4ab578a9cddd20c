/**
 * The errors of this package.
 *
 *     HofError
 *     ├── ConnectionFailed   no answer, or one that broke off
 *     ├── UnexpectedAnswer   an answer that is not the documented one: of another service, or of another version
 *     └── Problem            an error that the service answered; its `type` tells the kind
 */

import type { FieldError } from "./schema.js";

/** Kinds of problems. Other values of `type` come from proxies ("about:blank") and from newer services. */
export const PROBLEM_TYPES = [
  "urn:hof:problem:invalid-input",
  "urn:hof:problem:corrupt-image",
  "urn:hof:problem:corrupt-points",
  "urn:hof:problem:corrupt-weights",
  "urn:hof:problem:unauthenticated",
  "urn:hof:problem:forbidden",
  "urn:hof:problem:not-found",
  "urn:hof:problem:not-acceptable",
  "urn:hof:problem:stalled",
  "urn:hof:problem:in-use",
  "urn:hof:problem:too-large",
  "urn:hof:problem:unsupported-media-type",
  "urn:hof:problem:misdirected-request",
  "urn:hof:problem:invalid-parameter",
  "urn:hof:problem:no-object-found",
  "urn:hof:problem:invalid-spec",
  "urn:hof:problem:overloaded",
  "urn:hof:problem:rate-limited",
  "urn:hof:problem:head-too-large",
  "urn:hof:problem:not-ready",
  "urn:hof:problem:store-unavailable",
  "urn:hof:problem:http-version-not-supported",
  "urn:hof:problem:insufficient-storage",
] as const;

export type ProblemType = (typeof PROBLEM_TYPES)[number];

/** Base class of all errors of this package. */
export class HofError extends Error {
  override name = "HofError";
}

/** No answer, or one that broke off. */
export class ConnectionFailed extends HofError {
  override name = "ConnectionFailed";
}

/** An answer that is not the documented one: of another service, or of a version that does not fit. */
export class UnexpectedAnswer extends HofError {
  override name = "UnexpectedAnswer";
}

interface Members {
  type: ProblemType | (string & {});
  title: string;
  status: number;
  detail: string;
  errors: FieldError[];
  requestId: string;
  retryAfterS: number | undefined;
}

/** An error that the service answered (RFC 9457). */
export class Problem extends HofError implements Members {
  override name = "Problem";
  readonly type: Members["type"];
  readonly title: string;
  readonly status: number;
  /** The fault, and what to do. */
  readonly detail: string;
  /** One entry for each faulty parameter. */
  readonly errors: FieldError[];
  /** Id of the request in the service's log; "" if the answer has none. */
  readonly requestId: string;
  /** Seconds until a repeat may succeed; undefined if the answer does not say. */
  readonly retryAfterS: number | undefined;

  constructor(members: Members) {
    super(`${members.status} ${members.title}: ${members.detail}`);
    this.type = members.type;
    this.title = members.title;
    this.status = members.status;
    this.detail = members.detail;
    this.errors = members.errors;
    this.requestId = members.requestId;
    this.retryAfterS = members.retryAfterS;
  }
}

const MAX_TEXT = 200; // characters of an answer that is no problem+json

/** Read the error that an answer stands for. */
export async function problemOf(answer: Response): Promise<Problem> {
  const text = await answer.text();
  const members = membersOf(answer, text);
  return new Problem({
    type: members.type ?? "about:blank",
    title: members.title ?? (answer.statusText || "Error"),
    status: answer.status,
    detail: members.detail ?? (text.slice(0, MAX_TEXT).trim() || "the answer has no text"),
    errors: members.errors ?? [],
    requestId: answer.headers.get("X-Request-ID") ?? "",
    retryAfterS: secondsOf(answer.headers.get("Retry-After")),
  });
}

/** Return the seconds of a Retry-After header (RFC 9110, section 10.2.3): a number or a date; undefined without one. */
function secondsOf(retryAfter: string | null): number | undefined {
  if (retryAfter === null) return undefined;
  if (/^\d+$/.test(retryAfter.trim())) return Number(retryAfter);
  const date = Date.parse(retryAfter);
  return Number.isNaN(date) ? undefined : Math.max(0, (date - Date.now()) / 1000);
}

function membersOf(answer: Response, text: string): Partial<Members> {
  if (!answer.headers.get("Content-Type")?.startsWith("application/problem+json")) return {};
  try {
    const members: unknown = JSON.parse(text);
    return typeof members === "object" && members !== null ? members : {};
  } catch {
    return {};
  }
}
