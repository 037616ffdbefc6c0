//! Messages between a node that joins and the authority of a farm.

use std::sync::LazyLock;

use carom_farm::Error;
use carom_farm::carom_tracer::text::SENTENCE_BYTES_MAX;
use carom_farm::net::authority::lasting;
use carom_farm::net::enrolment_messages::{Certified, EnrolmentAnswer, EnrolmentRequest};
use carom_farm::net::farm_folder::check_name;
use carom_farm::net::{Authority, Role};

/// A request or an answer is none, or is read as it was written; a signing request, in a request or by itself, is
/// certified, or refused in a short sentence without control characters.
pub fn enrolment(bytes: &[u8]) {
    if bytes.first() == Some(&DER_SEQUENCE) {
        certify("oak", &pem(bytes));
    }
    match EnrolmentRequest::from_json(bytes) {
        Ok(request) => {
            let written = request.to_json().expect("a request that was read");
            let again = EnrolmentRequest::from_json(&written).expect("its own text");
            assert!(again == request);
            match request {
                EnrolmentRequest::Join {
                    name, request_pem, ..
                } => certify(&name, &request_pem),
                EnrolmentRequest::Renew { request_pem } => {
                    certify("oak", &request_pem.unwrap_or_default());
                }
            }
        }
        Err(why) => assert_told(&why),
    }
    match EnrolmentAnswer::from_json(bytes) {
        Ok(answer) => {
            let written = answer.to_json().expect("an answer that was read");
            let again = EnrolmentAnswer::from_json(&written).expect("its own text");
            assert!(again == answer);
            if let EnrolmentAnswer::Refused { sentence } = answer {
                assert_told(&Error::EnrolmentRefused(sentence));
            }
        }
        Err(why) => assert_told(&why),
    }
}

/// What the authority does for whoever shows a token.
fn certify(name: &str, request_pem: &str) {
    static AUTHORITY: LazyLock<Authority> =
        LazyLock::new(|| Authority::generate().expect("the system's randomness"));
    let role = Role::Node;
    let certified = check_name(name).and_then(|()| {
        let days = lasting(role.life());
        AUTHORITY.sign_request(role, name, days, request_pem)
    });
    if let Err(why) = certified {
        assert_told(&why);
    }
}

fn assert_told(why: &Error) {
    let sentence = why.to_string();
    assert!(!sentence.chars().any(char::is_control), "{sentence:?}");
    assert!(sentence.len() <= 2 * SENTENCE_BYTES_MAX, "{sentence:?}");
}

/// Each message, and a signing request of OpenSSL by itself.
pub fn enrolment_seeds() -> Vec<Vec<u8>> {
    let request_pem = pem(SIGNING_REQUEST);
    let requests = [
        EnrolmentRequest::Join {
            secret: "0123456789abcdef".repeat(2),
            name: "oak".to_owned(),
            request_pem: request_pem.clone(),
        },
        EnrolmentRequest::Renew {
            request_pem: Some(request_pem),
        },
        EnrolmentRequest::Renew { request_pem: None },
    ];
    let answers = [
        EnrolmentAnswer::Certified(Certified {
            authority_pem: "-----BEGIN CERTIFICATE-----".to_owned(),
            certificate_pem: None,
            deny_list: "0123 node oak\n".to_owned(),
        }),
        EnrolmentAnswer::Refused {
            sentence: "the token is not valid".to_owned(),
        },
    ];
    let mut seeds = vec![SIGNING_REQUEST.to_vec()];
    seeds.extend(requests.map(|request| request.to_json().expect("a valid request")));
    seeds.extend(answers.map(|answer| answer.to_json().expect("a valid answer")));
    seeds
}

/// `openssl req -new -subj / -outform DER` of a key on the curve P-256.
const SIGNING_REQUEST: &[u8] = include_bytes!("../seeds/signing_request.der");
/// The first byte of a signing request in DER.
const DER_SEQUENCE: u8 = 0x30;

/// A signing request as PEM text (RFC 7468).
fn pem(der: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::from("-----BEGIN CERTIFICATE REQUEST-----");
    for (group, bytes) in der.chunks(3).enumerate() {
        if group % 16 == 0 {
            text.push('\n');
        }
        let mut padded = [0; 4];
        padded[1..=bytes.len()].copy_from_slice(bytes);
        let bits = u32::from_be_bytes(padded);
        for digit in 0..4 {
            match digit <= bytes.len() {
                true => text.push(DIGITS[(bits >> (18 - 6 * digit)) as usize % 64].into()),
                false => text.push('='),
            }
        }
    }
    text.push_str("\n-----END CERTIFICATE REQUEST-----\n");
    text
}
