//! Messages of enrolment: one request and one answer, each JSON on a stream that ends.

use std::fmt::Display;

use serde::{Deserialize, Serialize};

use crate::Error;

/// What a node asks of the authority.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum EnrolmentRequest {
    /// To be admitted.
    Join {
        /// The token's.
        secret: String,
        /// What the node is to be called.
        name: String,
        /// A certificate signing request (RFC 2986) as PEM text.
        request_pem: String,
    },
    /// The deny list, and a new certificate of the same key if there is a request for one.
    Renew {
        /// As of [`EnrolmentRequest::Join`].
        request_pem: Option<String>,
    },
}

/// The answer.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum EnrolmentAnswer {
    /// What was asked for.
    Certified(Certified),
    /// Nothing.
    Refused {
        /// Why.
        sentence: String,
    },
}

/// What the authority has certified.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Certified {
    /// The authority's certificate.
    pub authority_pem: String,
    /// The node's, if it asked for one.
    pub certificate_pem: Option<String>,
    /// The text of the deny list.
    pub deny_list: String,
}

impl EnrolmentRequest {
    /// The request in JSON; the parser's reason is not told, which would repeat a stranger's text.
    ///
    /// # Errors
    /// [`Error::ConnectionBroken`] if it is none.
    pub fn from_json(bytes: &[u8]) -> Result<Self, Error> {
        serde_json::from_slice(bytes).map_err(|_| broken("what was sent is not a request"))
    }

    /// The request as JSON.
    ///
    /// # Errors
    /// None is known: those of the JSON library.
    pub fn to_json(&self) -> Result<Vec<u8>, Error> {
        serde_json::to_vec(self).map_err(broken)
    }
}

impl EnrolmentAnswer {
    /// The answer in JSON.
    ///
    /// # Errors
    /// [`Error::ConnectionBroken`] if it is none.
    pub fn from_json(bytes: &[u8]) -> Result<Self, Error> {
        serde_json::from_slice(bytes).map_err(broken)
    }

    /// The answer as JSON.
    ///
    /// # Errors
    /// None is known: those of the JSON library.
    pub fn to_json(&self) -> Result<Vec<u8>, Error> {
        serde_json::to_vec(self).map_err(broken)
    }
}

pub(crate) fn broken(why: impl Display) -> Error {
    Error::ConnectionBroken(why.to_string())
}
