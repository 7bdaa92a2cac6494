//! The messages `unitree_api` `Request_` and `Response_`, field by field as the vendor's IDL has them (unitree_sdk2_python,
//! `idl/unitree_api/msg/dds_`): all `@final`, without keys. Services of a robot are asked with them.

use serde::{Deserialize, Serialize};

/// Which request, and what it asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Number of the request, chosen by who asks.
    pub id: i64,
    /// What is asked for.
    pub api_id: i64,
}

/// Right to a service, of which one program has one at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lease {
    /// Its number; 0 without one.
    pub id: i64,
}

/// How a request is served.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Policy {
    /// Above 0: before others.
    pub priority: i32,
    /// Whether no answer is wanted.
    pub noreply: bool,
}

/// Head of a request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RequestHeader {
    /// Which it is.
    pub identity: Identity,
    /// By which right.
    pub lease: Lease,
    /// How it is served.
    pub policy: Policy,
}

/// What a service is asked, on `rt/api/SERVICE/request`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Request {
    /// Its head.
    pub header: RequestHeader,
    /// Arguments, JSON.
    pub parameter: String,
    /// Arguments of the few requests that are not JSON.
    pub binary: Vec<u8>,
}

/// How it went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// 0: well.
    pub code: i32,
}

/// Head of an answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResponseHeader {
    /// Of the request that it answers.
    pub identity: Identity,
    /// How it went.
    pub status: Status,
}

/// What a service answers, on `rt/api/SERVICE/response`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Response {
    /// Its head.
    pub header: ResponseHeader,
    /// The answer, JSON; empty where it went wrong.
    pub data: String,
    /// The answer of the few requests whose answer is not JSON.
    pub binary: Vec<u8>,
}
