//! Messages of enrolment: one request and one answer, each JSON on a stream that ends.

use std::fmt::Display;

use serde::{Deserialize, Serialize};

use crate::Error;

/// Request of a node to the authority.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum EnrolmentRequest {
    /// Admits a new node.
    Join {
        /// The secret of the token.
        secret: String,
        /// The name of the node.
        name: String,
        /// A certificate signing request (RFC 2986) as PEM text.
        request_pem: String,
    },
    /// Asks for the deny list, and for a new certificate of the same key if there is a signing request.
    Renew {
        /// As in [`EnrolmentRequest::Join`].
        request_pem: Option<String>,
    },
}

/// Answer of the authority.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum EnrolmentAnswer {
    /// The request is granted.
    Certified(Certified),
    /// The request is refused.
    Refused {
        /// The reason.
        sentence: String,
    },
}

/// Content of a granted request.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Certified {
    /// The authority's certificate.
    pub authority_pem: String,
    /// The node's certificate, if it asked for one.
    pub certificate_pem: Option<String>,
    /// The text of the deny list.
    pub deny_list: String,
}

impl EnrolmentRequest {
    /// Parses a request in JSON. The error hides the parser's reason, which would repeat a stranger's text.
    ///
    /// # Errors
    /// [`Error::ConnectionBroken`] if it is no request.
    pub fn from_json(bytes: &[u8]) -> Result<Self, Error> {
        serde_json::from_slice(bytes).map_err(|_| broken("what was sent is not a request"))
    }

    /// Serialises the request as JSON.
    ///
    /// # Errors
    /// Those of the JSON library, of which none is known to occur.
    pub fn to_json(&self) -> Result<Vec<u8>, Error> {
        serde_json::to_vec(self).map_err(broken)
    }
}

impl EnrolmentAnswer {
    /// Parses an answer in JSON.
    ///
    /// # Errors
    /// [`Error::ConnectionBroken`] if it is no answer.
    pub fn from_json(bytes: &[u8]) -> Result<Self, Error> {
        serde_json::from_slice(bytes).map_err(broken)
    }

    /// Serialises the answer as JSON.
    ///
    /// # Errors
    /// Those of the JSON library, of which none is known to occur.
    pub fn to_json(&self) -> Result<Vec<u8>, Error> {
        serde_json::to_vec(self).map_err(broken)
    }
}

pub(crate) fn broken(why: impl Display) -> Error {
    Error::ConnectionBroken(why.to_string())
}
