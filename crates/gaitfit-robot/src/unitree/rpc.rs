//! The messages `unitree_api` `Request_` and `Response_`, field by field as the vendor's IDL has them (unitree_sdk2_python,
//! `idl/unitree_api/msg/dds_`): all `@final`, without keys. Services of a robot are asked with them.

use serde::{Deserialize, Serialize};

/// Number of a request and its kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Number of the request, chosen by who asks.
    pub id: i64,
    /// Kind of the request, by the vendor's number.
    pub api_id: i64,
}

/// Right to a service, of which one program has one at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lease {
    /// Its number; 0 without one.
    pub id: i64,
}

/// Priority of a request, and whether it is answered.
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
    /// Number and kind.
    pub identity: Identity,
    /// The lease under which it is made.
    pub lease: Lease,
    /// Priority, and whether it is answered.
    pub policy: Policy,
}

/// Request to a service, on `rt/api/SERVICE/request`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Request {
    /// Its head.
    pub header: RequestHeader,
    /// Arguments, JSON.
    pub parameter: String,
    /// Arguments of the few requests that are not JSON.
    pub binary: Vec<u8>,
}

/// Success or failure of a request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Status {
    /// 0: well.
    pub code: i32,
}

/// Head of an answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResponseHeader {
    /// Number and kind of the request that it answers.
    pub identity: Identity,
    /// Success or failure.
    pub status: Status,
}

/// Answer of a service, on `rt/api/SERVICE/response`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Response {
    /// Its head.
    pub header: ResponseHeader,
    /// The answer, JSON; empty where it went wrong.
    pub data: String,
    /// The answer of the few requests whose answer is not JSON.
    pub binary: Vec<u8>,
}
