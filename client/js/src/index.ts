export { Client, type Options } from "./client.js";
export { CardPoints, isComputable } from "./function/card.js";
export { formOf, readFunctions } from "./function/weights.js";
export type { Form, Frame, Functions, Spec } from "./function/weights.js";
export { ConnectionFailed, HofError, Problem, PROBLEM_TYPES, UnexpectedAnswer, type ProblemType } from "./problems.js";
export type { Retry } from "./retries.js";
export type { Answer, JsonRoute, Raw, Request, Route } from "./routes.js";
export type * from "./schema.js";
