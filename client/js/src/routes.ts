// The types of all calls, from the schema: "GET /objects/{id}" names a call, and tells its parameters and its answer.

import type { paths } from "./schema.js";

type Method = "get" | "post" | "patch" | "delete";
type Documented = { parameters: object; responses: object };

/** Names of all calls: method and path. */
export type Route = {
  [P in keyof paths & string]: {
    [M in Method]: paths[P] extends Record<M, Documented> ? `${Uppercase<M>} ${P}` : never;
  }[Method];
}[keyof paths & string];

type Operation<R extends Route> = R extends `${infer M} ${infer P extends keyof paths & string}`
  ? Lowercase<M> extends keyof paths[P]
    ? Extract<paths[P][Lowercase<M>], Documented>
    : never
  : never;

type Parameters<R extends Route> = Operation<R>["parameters"];
type PathOf<R extends Route> = Parameters<R> extends { path: infer P } ? { path: P } : { path?: never };
type QueryOf<R extends Route> = Parameters<R> extends { query?: infer Q } ? { query?: Q } : { query?: never };

/** Content of a body that is sent as it is. */
export type Raw = Blob | ArrayBuffer | Uint8Array<ArrayBuffer> | FormData;

type Content<R extends Route> = Operation<R> extends { requestBody: { content: infer C } } ? C : never;
type BodyOf<R extends Route> = [Content<R>] extends [never]
  ? { body?: never }
  : {
      body: Content<R> extends { "application/json": infer J }
        ? J | (keyof Content<R> extends "application/json" ? never : Raw)
        : Raw;
    };

/** Parameters of a call: of its path, its query and its body, as the API has them. */
export type Request<R extends Route> = PathOf<R> &
  QueryOf<R> &
  BodyOf<R> & { headers?: Record<string, string>; signal?: AbortSignal | undefined };

/** Whether a request can be left out. */
export type Arguments<R extends Route> = {} extends Request<R> ? [request?: Request<R>] : [request: Request<R>];

type Success<R extends Route> = Operation<R>["responses"] extends infer S
  ? S extends object
    ? S[keyof S & (200 | 201)]
    : never
  : never;

type Json<S> = S extends { content: { "application/json": infer J } } ? J : never;

/** The JSON answer of a call; `never` for calls that answer files alone. */
export type Answer<R extends Route> = R extends `DELETE ${string}` ? undefined : Json<Success<R>>;

/** Names of the calls that answer JSON, or nothing. */
export type JsonRoute = { [R in Route]: [Answer<R>] extends [never] ? never : R }[Route];
