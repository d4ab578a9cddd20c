import { readFunctions, type Functions } from "./function/weights.js";
import { readPoints } from "./points.js";
import { ConnectionFailed, problemOf, UnexpectedAnswer } from "./problems.js";
import { repeated, RETRY, type Retry } from "./retries.js";
import type { Answer, Arguments, JsonRoute, Raw, Request, Route } from "./routes.js";
import type { EncodedObject } from "./schema.js";

export interface Options {
  /** The key, if the service needs one. */
  apiKey?: string;
  retry?: Partial<Retry>;
}

type Query<R extends Route> = NonNullable<Request<R>["query"]>;
type PointsQuery = Omit<Query<"GET /objects/{id}/points">, "format" | "color">;
type AnyRequest = {
  path?: object;
  query?: object;
  body?: unknown;
  headers?: Record<string, string>;
  signal?: AbortSignal | undefined;
};

/** Calls of a HOF service. All throw HofError, or the reason of their signal if that is aborted. */
export class Client {
  readonly #url: string;
  readonly #headers: Record<string, string>;
  readonly #retry: Retry;

  /** `url`: of the service, for example "http://localhost:8080". */
  constructor(url: string | URL, { apiKey, retry }: Options = {}) {
    this.#url = String(url).replace(/\/$/, "");
    this.#headers = apiKey === undefined ? {} : { Authorization: `Bearer ${apiKey}` };
    this.#retry = { ...RETRY, ...retry };
  }

  /** Send a call and return its JSON answer: `await hof.call("GET /objects/{id}", { path: { id } })`. */
  async call<R extends JsonRoute>(route: R, ...[request]: Arguments<R>): Promise<Answer<R>> {
    const sent = request as AnyRequest | undefined;
    const headers = { Accept: "application/json", ...sent?.headers };
    return this.#repeated(route, { ...sent, headers }, async (answer) => {
      if (answer.status === 204) return undefined as Answer<R>;
      const type = answer.headers.get("Content-Type") ?? "no type";
      if (!type.startsWith("application/json")) {
        throw new UnexpectedAnswer(`${answer.url} answered ${type} instead of JSON: is this a HOF service?`);
      }
      return answer.json();
    });
  }

  /** Send a call and return its answer, whose body is still to be read. */
  async fetch<R extends Route>(route: R, ...[request]: Arguments<R>): Promise<Response> {
    return this.#repeated(route, (request ?? {}) as AnyRequest, async (answer) => answer);
  }

  /** Send a call and return the bytes of its answer. */
  async bytes<R extends Route>(route: R, ...[request]: Arguments<R>): Promise<ArrayBuffer> {
    return this.#repeated(route, (request ?? {}) as AnyRequest, (answer) => answer.arrayBuffer());
  }

  /** Encode a photo (a file of an image) and return the stored object. */
  async encode(
    photo: Blob | ArrayBuffer | Uint8Array<ArrayBuffer>,
    query: Omit<Query<"POST /encode">, "store"> = {},
    signal?: AbortSignal,
  ): Promise<EncodedObject> {
    const request = { query, body: photo, signal };
    return (await this.call("POST /encode", request)) as EncodedObject;
  }

  /**
   * Points of an object: x, y and z of each, (3 n) numbers. The array is filled while bytes arrive; `take` is called
   * with each further part of it, as a view.
   */
  async points(
    id: string,
    query: PointsQuery = {},
    { take, signal }: { take?: (part: Float32Array, offset: number) => void; signal?: AbortSignal } = {},
  ): Promise<Float32Array> {
    const request = { path: { id }, query: { ...query, format: "f32" }, signal };
    return this.#repeated("GET /objects/{id}/points", request, (answer) => readPoints(answer, take));
  }

  /** The functions of an object, for `sample` and `CardPoints`. */
  async functions(id: string, signal?: AbortSignal): Promise<Functions> {
    const query = { format: "safetensors" } as const;
    return readFunctions(await this.bytes("GET /objects/{id}/weights", { path: { id }, query, signal }));
  }

  async #repeated<T>(route: Route, request: AnyRequest, read: (answer: Response) => Promise<T>): Promise<T> {
    const { signal } = request;
    const once = async () => {
      try {
        const answer = await this.#send(route, request);
        if (!answer.ok) throw await problemOf(answer);
        return await read(answer);
      } catch (error) {
        signal?.throwIfAborted();
        if (error instanceof TypeError) throw new ConnectionFailed(`${this.#url}: ${reasonOf(error)}`, { cause: error });
        throw error;
      }
    };
    return repeated(once, this.#retry, !route.startsWith("DELETE"), signal);
  }

  #send(route: Route, { path, query, body, headers, signal }: AnyRequest): Promise<Response> {
    const [method, template] = route.split(" ") as [string, string];
    const parameters = new Map(Object.entries(path ?? {}));
    const place = template.replace(/\{(\w+)\}/g, (_, name: string) => encodeURIComponent(String(parameters.get(name))));
    const given = Object.entries(query ?? {}).filter(([, value]) => value !== undefined);
    const search = given.length ? `?${new URLSearchParams(given.map(([name, value]) => [name, String(value)]))}` : "";
    const [content, type] = contentOf(body);
    return fetch(`${this.#url}${place}${search}`, {
      method,
      headers: { ...type, ...this.#headers, ...headers },
      ...(content !== undefined && { body: content }),
      signal: signal ?? null,
    });
  }
}

/** Return a body as fetch takes it, and its Content-Type unless fetch or the blob tells it. */
function contentOf(body: unknown): [Raw | string | undefined, Record<string, string>] {
  const octets = { "Content-Type": "application/octet-stream" };
  if (body === undefined) return [undefined, {}];
  if (body instanceof FormData) return [body, {}];
  if (body instanceof Blob) return [body, body.type ? {} : octets];
  if (body instanceof ArrayBuffer || ArrayBuffer.isView(body)) return [body as ArrayBuffer, octets];
  return [JSON.stringify(body), { "Content-Type": "application/json" }];
}

function reasonOf({ message, cause }: Error): string {
  return cause instanceof Error && cause.message ? `${message}: ${cause.message}` : message;
}
