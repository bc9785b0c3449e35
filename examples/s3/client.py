"""What the scripts of this folder ask of a service besides turbid: keys, a bucket, objects that are in the way.

Endpoint and keys come from the environment (AWS_ENDPOINT_URL, AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY).
"""

import json
import sys

import boto3


def client(service):
    return boto3.client(service, region_name="us-east-1")


def keys():
    """A user of moto who may do everything in S3; prints the id of the access key and the secret."""
    iam = client("iam")
    iam.create_user(UserName="lab")
    allowed = {"Version": "2012-10-17", "Statement": [{"Effect": "Allow", "Action": "s3:*", "Resource": "*"}]}
    iam.put_user_policy(UserName="lab", PolicyName="s3", PolicyDocument=json.dumps(allowed))
    key = iam.create_access_key(UserName="lab")["AccessKey"]
    print(key["AccessKeyId"], key["SecretAccessKey"])


def bucket(name):
    client("s3").create_bucket(Bucket=name)


def clutter(name, prefix, count):
    """So many objects whose names come before almost all others of the prefix."""
    s3 = client("s3")
    for n in range(int(count)):
        s3.put_object(Bucket=name, Key=f"{prefix}/{n:064x}", Body=b"")


if __name__ == "__main__":
    {"keys": keys, "bucket": bucket, "clutter": clutter}[sys.argv[1]](*sys.argv[2:])
